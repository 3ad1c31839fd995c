// The link's core as saved state.
#include "realtime/kernel/state_archive.hpp"
#include "realtime/onboard/link/link_core.hpp"

namespace fathom::onboard {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("LNKC"), kVersion = 3;

}  // namespace

template <typename Archive, typename Self>
void LinkCore::exchange(Archive& archive, Self& self) {
  archive(self.fine_, self.coarse_, self.detailed_, self.area_total_, self.detail_squares_,
          self.detail_left_out_);
  archive.require(self.detailed_.size() <= self.config_.max_detailed, "more detail than is followed");
  archive.require(self.detail_squares_ >= 0, "fewer squares served than none");
}

void LinkCore::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
  writer(scheduler_);
}

bool LinkCore::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] { exchange(reader, *this); }) && reader(scheduler_);
}

}  // namespace fathom::onboard
