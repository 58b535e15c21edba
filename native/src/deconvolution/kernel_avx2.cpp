#include "kernel.hpp"

namespace omnimirror {

const DeconvolutionKernel avx2_deconvolution{&improve, &log_steepness, &blurred, &light};

}  // namespace omnimirror
