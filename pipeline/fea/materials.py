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
    "alexander",
    "anssari_benam_bucchi",
    "lopez_pamies",
)


def strain_energy(material: Material) -> felupe.Hyperelastic:
    """The isochoric part of a law (FElupe material, by automatic differentiation); raises ValueError."""
    if material.law not in LAWS:
        raise ValueError(f"law = {material.law!r} is not known: choose one of {', '.join(LAWS)}")
    return felupe.Hyperelastic(getattr(felupe.constitution, material.law), **material.parameters)


def law(material: Material) -> felupe.CompositeMaterial:
    """The whole law: its isochoric part and the volumetric one, K/2 (J − 1)²; raises ValueError."""
    return strain_energy(material) & felupe.Volumetric(bulk=material.bulk)
