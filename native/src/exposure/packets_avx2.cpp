#include "packets.hpp"

namespace omnimirror {

const PacketKernels avx2_packets{&trace};

}  // namespace omnimirror
