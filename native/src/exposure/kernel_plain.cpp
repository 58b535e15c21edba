#include "rows.hpp"

namespace omnimirror {

const ExposureKernels plain_exposure{&light_of_row, &rays_of_row, &rays_of_block};

}  // namespace omnimirror
