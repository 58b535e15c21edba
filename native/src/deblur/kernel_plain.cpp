#include "kernel.hpp"

namespace omnimirror {

const SharpeningKernel plain_sharpening{&improve, &log_steepness, &blurred, &light};

}  // namespace omnimirror
