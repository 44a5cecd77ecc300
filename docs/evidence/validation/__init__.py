"""Verification and validation: the stages on flows with known answers (docs/verification.md)."""
