// The kernels for every machine.
#include "axial_kernel.hpp"
#include "footprint.hpp"

namespace omnimirror {

const Kernels plain_kernels{"plain", false, &sample<Plain>, &average<Plain, PlainSums>, &pack<Plain>, &project_targets};

}  // namespace omnimirror
