#include "sim/hil/players/modem_player.hpp"

#include <array>
#include <deque>
#include <optional>

#include "firmware_if/devices/modem/modem_ports.hpp"
#include "realtime/base/units.hpp"
#include "sim/hil/players/pseudo_terminal.hpp"

namespace fathom::sim {
namespace {

constexpr std::int64_t kTurnNs = 20'000'000;  // far shorter than a frame's transmission

// The modem's end of the serial cable, with SLIP frames.
class TerminalPort final : public FramePort {
 public:
  explicit TerminalPort(const std::filesystem::path& link) : terminal_(link) {}
  bool send(std::span<const std::uint8_t> frame) noexcept override {
    std::array<std::uint8_t, io::kMaxSlipBytes> line{};
    const std::size_t size = io::slipEncode(frame, line);
    return size > 0 && terminal_.write(std::span(line).first(size));
  }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    while (true) {
      while (at_ < size_) {
        if (!decoder_.push(input_[at_++])) continue;
        const auto frame = decoder_.frame();
        std::copy(frame.begin(), frame.end(), buffer.begin());
        return frame.size();
      }
      at_ = 0;
      size_ = terminal_.read(input_);
      if (size_ == 0) return 0;
    }
  }
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return decoder_.dropped(); }

 private:
  PseudoTerminal terminal_;
  io::SlipDecoder decoder_;
  std::array<std::uint8_t, 512> input_{};
  std::size_t size_ = 0, at_ = 0;
};

}  // namespace

struct ModemPlayer::Impl {
  Impl(const MissionSchedule& s, const FaultScript& f, SimulatedVehicleClock& c,
       const std::filesystem::path& packet_file, const SimulatedShipOptions& water)
      : schedule(s), script(f), clock(c), ship(packet_file, water) {
    for (const ScheduledSample& sample : s.samples)
      if (const auto* fix = std::get_if<UsblFix>(&sample.sample)) fixes.push_back({sample.due_utc_ns, *fix});
  }

  void turn() {
    const std::int64_t now_ns = clock.utcNs();
    while (!fixes.empty() && fixes.front().due_ns <= now_ns) {
      const UsblFix& fix = fixes.front().fix;
      ship.addFix({fix.utc_ns, radiansToDegrees(fix.latitude), radiansToDegrees(fix.longitude), fix.depth,
                   fix.sigma_horizontal});
      fixes.pop_front();
      ++counters.fixes;
    }
    const bool silent = script.at(FaultKind::kModemSilence, schedule.missionSeconds(now_ns)) != nullptr;
    std::array<std::uint8_t, FramePort::kMaxFrameBytes> buffer{};
    const auto carry = [&](FramePort& from, FramePort& to, std::uint64_t& count) {
      while (const std::size_t size = from.receive(buffer)) {
        from.answerLastSender();  // the water is open to all
        if (silent) {
          ++counters.silenced;
        } else if (to.send(std::span(buffer).first(size))) {
          ++count;
        }
      }
    };
    carry(*port, ship.modem(), counters.from_vehicle);
    ship.advance(now_ns);
    carry(ship.modem(), *port, counters.to_vehicle);
    fixes_sent = counters.fixes == ship.summary().fixes_sent;
  }

  struct DueFix {
    std::int64_t due_ns = 0;
    UsblFix fix;
  };
  const MissionSchedule& schedule;
  FaultScript script;
  SimulatedVehicleClock& clock;
  SimulatedShip ship;
  std::unique_ptr<FramePort> port;
  std::uint16_t udp_port = 0;
  std::deque<DueFix> fixes;
  Counters counters;
  std::atomic<bool> fixes_sent{true};
};

ModemPlayer::ModemPlayer(const MissionSchedule& schedule, const FaultScript& script,
                         SimulatedVehicleClock& clock, const std::filesystem::path& packet_file,
                         const SimulatedShipOptions& water, const std::filesystem::path& port)
    : impl_(std::make_unique<Impl>(schedule, script, clock, packet_file, water)) {
  impl_->port = std::make_unique<TerminalPort>(port);
}
ModemPlayer::ModemPlayer(const MissionSchedule& schedule, const FaultScript& script,
                         SimulatedVehicleClock& clock, const std::filesystem::path& packet_file,
                         const SimulatedShipOptions& water, std::uint16_t udp_port)
    : impl_(std::make_unique<Impl>(schedule, script, clock, packet_file, water)) {
  auto port = std::make_unique<io::UdpFramePort>("127.0.0.1", udp_port, "", 0);
  impl_->udp_port = port->boundPort();
  impl_->port = std::move(port);
}
ModemPlayer::~ModemPlayer() = default;

std::uint16_t ModemPlayer::udpPort() const {
  return impl_->udp_port;
}

bool ModemPlayer::fixesSent() const {
  return impl_->fixes_sent;
}

void ModemPlayer::run(const std::atomic<bool>& stop) {
  std::int64_t next_ns = impl_->clock.utcNs();
  while (impl_->clock.sleepUntil(next_ns += kTurnNs, stop)) impl_->turn();
  impl_->turn();
  impl_->ship.finish();
}

ModemPlayer::Counters ModemPlayer::counters() const {
  Counters c = impl_->counters;
  c.ship = impl_->ship.summary();
  c.broken = impl_->port->droppedFrames();
  return c;
}

}  // namespace fathom::sim
