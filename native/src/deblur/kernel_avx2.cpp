#include "kernel.hpp"

namespace omnimirror {

const SharpeningKernel avx2_sharpening{&improve, &log_steepness, &blurred, &light};

}  // namespace omnimirror
