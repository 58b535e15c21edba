#include "kernel.hpp"

namespace omnimirror {

const ExposureKernels avx2_exposure{"avx2", &light_of_row, &rays_of_row};

}  // namespace omnimirror
