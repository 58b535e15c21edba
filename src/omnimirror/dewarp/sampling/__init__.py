"""Image interpolation at fractional coordinates: compiled, or OpenCV without the compiled module.

Both implementations have a common definition. Coordinates from half a pixel before the first pixel
centre to half a pixel after the last one are inside the image; on the outermost half pixel the
image has its edge value. NaN and all other coordinates are outside and yield the border value,
without smearing. Cubic is the kernel of Keys [1]_ with a = -0.75, as in OpenCV; its taps outside
the image repeat the edge. Area is the mean of cubic samples over the footprint of an output pixel,
restricted to samples inside the image; auto equals area for minified pixels, and cubic otherwise
(see :mod:`omnimirror.dewarp.sampling.footprints`).

Results agree within one grey level. Coordinates are rounded to float32 before sampling; the
compiled samplers quantise fractions of a pixel to 1/255 in uint8 images and to 1/65535 in others.

.. [1] R. G. Keys, Cubic convolution interpolation for digital image processing, IEEE Trans. ASSP 29 (1981).
"""
