#include "packets.hpp"

namespace omnimirror {

const PacketKernels plain_packets{&trace};

}  // namespace omnimirror
