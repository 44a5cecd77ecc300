"""Verification and validation: the project's own stages on flows whose answer is known (docs/verification.md)."""
