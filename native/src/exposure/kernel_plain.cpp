#include "kernel.hpp"

namespace omnimirror {

const ExposureKernels plain_exposure{"plain", &light_of_row, &rays_of_row};

}  // namespace omnimirror
