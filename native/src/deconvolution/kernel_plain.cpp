#include "kernel.hpp"

namespace omnimirror {

const DeconvolutionKernel plain_deconvolution{&improve, &log_steepness, &blurred, &light};

}  // namespace omnimirror
