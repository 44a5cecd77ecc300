"""Hyperelastic laws by name, through FElupe's constitution."""

import felupe

from pipeline.fea.settings import Material

_LAWS = (
    "neo_hooke",
    "mooney_rivlin",
    "yeoh",
    "ogden",
    "third_order_deformation",
    "arruda_boyce",
    "extended_tube",
    "alexander",
    "anssari_benam_bucchi",
    "lopez_pamies",
)


def strain_energy(material: Material) -> felupe.Hyperelastic:
    """The isochoric part of a law, by automatic differentiation; raises ValueError."""
    if material.law not in _LAWS:
        raise ValueError(f"law = {material.law!r} is not known: choose one of {', '.join(_LAWS)}")
    return felupe.Hyperelastic(getattr(felupe.constitution, material.law), **material.parameters)
