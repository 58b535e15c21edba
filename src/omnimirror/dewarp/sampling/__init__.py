"""Values of a picture at fractional places: compiled, or by OpenCV where nothing was compiled.

Both follow one rule. A place from half a pixel before the first pixel's centre to half a pixel behind the
last one's lies on the picture; on that outermost half pixel the picture has the value of its edge. NaN and all
other places lie outside and give the border's value: nothing is smeared. Cubic is the kernel of Keys [1]_ with
a = -0.75, as in OpenCV; its taps beyond the picture repeat the edge. Area is the mean of cubic samples over what an
output pixel covers in the picture, of those that are inside; auto is the same where the picture is minified, and
cubic elsewhere (see :mod:`omnimirror.dewarp.sampling.footprints`).

Values agree to one grey level. Places are rounded to float32 before they are sampled; the compiled samplers take
fractions of a pixel to 1/255 in uint8 pictures and to 1/65535 in others.

.. [1] R. G. Keys, Cubic convolution interpolation for digital image processing, IEEE Trans. ASSP 29 (1981).
"""
