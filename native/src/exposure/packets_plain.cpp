#include "packets.hpp"

namespace omnimirror {

const PacketKernels plain_packets{&see};

}  // namespace omnimirror
