"""Hyperelastic laws by name, through FElupe's constitution."""

from __future__ import annotations

import felupe

from pipeline.fea.settings import Material

LAWS = (
    "neo_hooke",
    "mooney_rivlin",
    "yeoh",
    "ogden",
    "third_order_deformation",
    "arruda_boyce",
    "extended_tube",
    "van_der_waals",
    "alexander",
    "anssari_benam_bucchi",
    "lopez_pamies",
)


def strain_energy(material: Material) -> felupe.Hyperelastic:
    """The law's isochoric part (FElupe material, by automatic differentiation); raises ValueError."""
    if material.law not in LAWS:
        raise ValueError(f"law = {material.law!r} is not known: choose one of {', '.join(LAWS)}")
    function = felupe.constitution.isochoric_volumetric_split(getattr(felupe.constitution, material.law))
    return felupe.Hyperelastic(function, **material.parameters)
