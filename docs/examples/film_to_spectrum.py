"""The spectrum along x of the velocity in a film."""

import matplotlib.pyplot as plt

from piv import (
    Options,
    SequenceOptions,
    correlate_recording,
    open_recording,
    read_plane,
    space_spectrum,
)

with open_recording("docs/tutorials/frames") as film:
    correlate_recording(film, "film.h5", Options(window=24, spacing=8), SequenceOptions())
spectrum = space_spectrum(read_plane("film.h5"), "x")
plt.loglog(spectrum["frequency"], spectrum["psd_u"], label="u")
plt.loglog(spectrum["frequency"], spectrum["psd_v"], label="v")
plt.xlabel("wavenumber, 1/px")
plt.ylabel("power spectral density, px³ per frame²")
plt.legend()
plt.savefig("film_to_spectrum.png", dpi=120)
