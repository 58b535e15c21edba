// The portable kernels.
#include "axial_kernel.hpp"
#include "footprint.hpp"

namespace omnimirror {

const Kernels plain_kernels{"plain", Level::PLAIN, &sample<Plain>, &average<Plain, PlainSums>, &pack<Plain>, &project_targets};

}  // namespace omnimirror
