// The kernels for every machine.
#include "common.hpp"

namespace omnimirror {

const Kernels plain_kernels{"plain", &sample<Plain>, &pack<Plain>};

}  // namespace omnimirror
