#include "rows.hpp"

namespace omnimirror {

const ExposureKernels avx2_exposure{&light_of_row, &rays_of_row, &rays_of_block};

}  // namespace omnimirror
