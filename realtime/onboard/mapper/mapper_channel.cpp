#include "realtime/onboard/mapper/mapper_channel.hpp"

#include <new>

namespace fathom::onboard {

MapperChannel::MapperChannel()
    : down_memory_(sizeof(MapperDown)),
      up_memory_(sizeof(MapperUp)),
      down_(new (down_memory_.data()) MapperDown),
      up_(new (up_memory_.data()) MapperUp) {}

MapperChannel::MapperChannel(int down_file, int up_file)
    : down_memory_(down_file, sizeof(MapperDown), false),
      up_memory_(up_file, sizeof(MapperUp), true),
      down_(std::launder(reinterpret_cast<MapperDown*>(down_memory_.data()))),
      up_(std::launder(reinterpret_cast<MapperUp*>(up_memory_.data()))) {}

}  // namespace fathom::onboard
