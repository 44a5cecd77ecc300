"""Recordings: opening them, masks, preprocessing and calibration."""
