#include "packets.hpp"

namespace omnimirror {

const PacketKernels avx2_packets{&see};

}  // namespace omnimirror
