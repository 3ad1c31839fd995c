#include "sim/link/simulated_ship.hpp"

#include <array>
#include <deque>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "sim/link/channel.hpp"
#include "telemetry/ship/ship_link.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::sim {
namespace {

ChannelConfig waterOf(const SimulatedShipOptions& options) {
  ChannelConfig water;
  water.loss = options.loss;
  water.duplicate = options.duplicate;
  water.reorder = options.reorder;
  water.corrupt = options.corrupt;
  water.mean_burst = options.mean_burst;
  water.delay_s = options.delay_s;
  water.rate_bps = options.rate_bps;
  water.preamble_s = options.preamble_s;
  water.seed = options.seed;
  try {
    validate(water);
  } catch (const std::invalid_argument& e) {
    throw InputError("simulated water", "", e.what());
  }
  return water;
}

}  // namespace

struct SimulatedShip::Impl {
  Impl(const std::filesystem::path& packet_file, const SimulatedShipOptions& o)
      : options(o), water(waterOf(o), waterOf(o), o.half_duplex), file(packet_file) {
    switchOn();
  }

  void switchOn() {
    telemetry::ShipLinkConfig config;
    config.frame_bytes = options.frame_bytes;
    ship = std::make_unique<telemetry::ShipLink>(std::nullopt, options.key, config);
  }
  [[nodiscard]] bool off(double t) const { return t >= options.off_from_s && t < options.off_to_s; }

  [[nodiscard]] std::uint64_t fixesSentNow() const {
    return ship && ship->sender() ? ship->sender()->counters().fixes : 0;
  }

  // Receives the frames that have arrived by mission second `t` and answers them.
  void receiveUntil(double t) {
    water.advance(t);
    const std::int64_t now_ns = first_ns + static_cast<std::int64_t>(t * kNanosecondsPerSecond);
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
    if (off(t) && ship) {
      repaired += ship->receiver().counters().repaired;
      fixes_sent += fixesSentNow();
      fix_given = false;
      ship.reset();
    }
    if (!off(t) && !ship) switchOn();
    while (const std::size_t size = water.ship().receive(buffer)) {
      if (!ship) continue;
      const std::span<const std::uint8_t> frame(buffer.data(), size);
      if (!telemetry::writePacket(file.stream(), now_ns, frame))
        throw std::runtime_error("the ship's frames cannot be written (disk full?)");
      ++frames_received;
      ship->receive(frame, [&](std::span<const std::uint8_t> link_frame) {
        return ship->accept(now_ns, link_frame, [](const auto&) { return true; }).verdict ==
               telemetry::FrameVerdict::kAccepted;
      });
    }
    if (!ship) return;
    // The sender keeps one fix: the next follows when that one is sent or stale.
    if (telemetry::DownlinkSender* sender = ship->sender(); sender != nullptr && !fixes.empty()) {
      const std::uint64_t done = sender->counters().fixes + sender->counters().stale_fixes;
      if (!fix_given || done != fixes_done) {
        fixes_done = done;
        fix_given = sender->addFix(fixes.front());
        fixes.pop_front();
      }
    }
    if (const std::size_t size = ship->nextFrame(now_ns, buffer)) {
      ++answers;
      static_cast<void>(water.ship().send(std::span(buffer).first(size)));
    }
  }

  SimulatedShipOptions options;
  ChannelPair water;
  AtomicFile file;
  std::unique_ptr<telemetry::ShipLink> ship;    // null while it is switched off
  std::deque<telemetry::UsblFixMessage> fixes;  // not yet given to the sender
  bool fix_given = false;                       // at least one to the sender
  std::uint64_t fixes_done = 0;                 // sent or stale when it got its last
  std::uint64_t fixes_sent = 0;                 // before the last switch-on
  bool started = false;
  std::int64_t first_ns = 0;
  std::uint64_t frames_received = 0, answers = 0, repaired = 0;
};

SimulatedShip::SimulatedShip(const std::filesystem::path& packet_file, const SimulatedShipOptions& options) {
  if (!(options.off_from_s >= 0) || !(options.off_to_s >= options.off_from_s))
    throw InputError("--off", "", "give two times of the mission [s], the first not after the second");
  const std::filesystem::path folder = packet_file.has_parent_path() ? packet_file.parent_path() : ".";
  if (!std::filesystem::is_directory(folder) || std::filesystem::is_directory(packet_file))
    throw InputError(packet_file.string(), "", "cannot be written; name a file in a folder that is there");
  impl_ = std::make_unique<Impl>(packet_file, options);
}
SimulatedShip::~SimulatedShip() = default;

FramePort& SimulatedShip::modem() {
  return impl_->water.vehicle();
}

void SimulatedShip::addFix(const telemetry::UsblFixMessage& fix) {
  impl_->fixes.push_back(fix);
}

void SimulatedShip::advance(std::int64_t now_ns) {
  Impl& i = *impl_;
  if (!i.started) i.first_ns = now_ns;
  i.started = true;
  const double now = static_cast<double>(now_ns - i.first_ns) / kNanosecondsPerSecond;
  // Frame by frame, each at its own time.
  for (double next = i.water.uplink().nextArrival(); next >= 0 && next < now;
       next = i.water.uplink().nextArrival())
    i.receiveUntil(next);
  i.receiveUntil(now);
}

void SimulatedShip::finish() {
  impl_->file.commit();
}

SimulatedShip::Summary SimulatedShip::summary() const {
  const AcousticChannel::Counters &up = impl_->water.uplink().counters(),
                                  &down = impl_->water.downlink().counters();
  Summary s;
  s.sent = up.offered - up.refused;
  s.received = impl_->frames_received;
  s.collided = up.collided;
  s.repaired = impl_->repaired + (impl_->ship ? impl_->ship->receiver().counters().repaired : 0);
  s.answers = impl_->answers;
  s.answers_received = down.delivered;
  s.fixes_sent = impl_->fixes_sent + impl_->fixesSentNow();
  s.fixes_waiting = impl_->fixes.size();
  s.loss = s.sent > 0 ? static_cast<double>(up.lost + up.collided) / static_cast<double>(s.sent) : 0;
  return s;
}

}  // namespace fathom::sim
