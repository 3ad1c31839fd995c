// What the vehicle has heard, as saved state.
#include "realtime/kernel/state_archive.hpp"
#include "telemetry/downlink/downlink.hpp"

namespace fathom::telemetry {
namespace {

constexpr std::uint32_t kTag = rt::stateTag("DOWN"), kVersion = 3;

template <typename Archive, typename R>
void exchangeRequest(Archive& archive, R& r) {
  archive.enumeration(r.kind, static_cast<Request::Kind>(kRequestKinds - 1));
  archive(r.id, r.north_min, r.north_max, r.east_min, r.east_max, r.spacing, r.max_error, r.rate_bps);
}

}  // namespace

template <typename Archive, typename Self>
void DownlinkReceiver::exchange(Archive& archive, Self& self) {
  archive(self.counter_, self.heard_, self.acknowledged_, self.counters_, self.next_detail_);
  for (auto& heard : self.details_) {
    bool there = heard.has_value();
    archive(there);
    if constexpr (Archive::kLoading) {
      heard.reset();
      if (there) heard = Heard{};
    }
    if (!there) continue;
    archive.instants(heard->utc_ns);
    exchangeRequest(archive, heard->request);
  }
}

void DownlinkReceiver::save(rt::StateWriter& writer) const {
  writer.section(kTag, kVersion, [&] { exchange(writer, *this); });
}

bool DownlinkReceiver::load(rt::StateReader& reader) {
  return reader.section(kTag, kVersion, [&] { exchange(reader, *this); });
}

}  // namespace fathom::telemetry
