#include "realtime/onboard/mapper/mapper_channel.hpp"

#include <cmath>
#include <cstddef>
#include <cstring>
#include <new>

namespace fathom::onboard {
namespace {

// The bytes of a value that may be none of its type.
template <class T>
unsigned byteOf(const T& value) noexcept {
  static_assert(sizeof(T) == 1);
  unsigned char byte = 0;
  std::memcpy(&byte, &value, 1);
  return byte;
}

bool canBe(const MapState& s) noexcept {
  constexpr double kNearOne = 1e-3;
  const telemetry::Status& status = s.status;
  bool finite = s.T_nav_odom.translation().allFinite() && std::isfinite(s.mapped_area);
  for (const double value : {status.north, status.east, status.depth, status.roll, status.pitch,
                             status.heading, status.speed, status.map_area})
    finite = finite && std::isfinite(value);
  return finite && std::abs(s.T_nav_odom.rotation().squaredNorm() - 1) < kNearOne &&
         byteOf(s.anchored) <= 1 &&
         byteOf(s.level) <= static_cast<unsigned>(rt::DegradationLevel::kDropFrames);
}

}  // namespace

bool MapperUp::readMap(MapState& shown) const noexcept {
  MapState read;
  if (!state.read(read) || !canBe(read)) return false;
  shown = read;
  return true;
}

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
