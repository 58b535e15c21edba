"""Commands that take, straighten, sharpen and show pictures."""
