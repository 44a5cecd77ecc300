"""Vortices of plane fields: detection, fit, circulation, tracks."""
