#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "firmware_if/devices/lcm/health_report.hpp"
#include "firmware_if/devices/sample_source.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "firmware_if/mission/log/log_messages.hpp"
#include "realtime/base/config_keys.hpp"

namespace fathom::io {

// A connection to an LCM bus. liblcm receives on a thread of its own and keeps waiting messages in its own
// memory; both are best effort and outside the program's pools. publish() and refused() may be called from
// several threads, everything else from one.
//
// A bus that cannot be joined now (no interface up, no multicast route) or that fails is joined by poll(),
// after 2, 4... 64 s, with its subscription; until then nothing comes and publish() refuses. A try may take
// some seconds: liblcm waits for a message of its own to come back.
class LcmBus {
 public:
  // `url` as lcm_create() takes it: "udpm://239.255.76.67:7667?ttl=0" stays on this machine and "?ttl=1"
  // reaches the network beside it; "memq://" stays in this object. Tries to join. Throws InputError for a url
  // that can never be joined.
  explicit LcmBus(const std::string& url, std::int64_t first_wait_ns = 2'000'000'000);
  ~LcmBus();
  LcmBus(const LcmBus&) = delete;
  LcmBus& operator=(const LcmBus&) = delete;

  // False when there is no bus or the system refused it; counted.
  bool publish(const LogMessage& message) noexcept;
  [[nodiscard]] std::uint64_t refused() const noexcept;

  class Receiver {
   public:
    virtual ~Receiver() = default;
    virtual void message(std::string_view channel, std::span<const std::uint8_t> data) noexcept = 0;
  };
  // Channels that match the regular expression `channels` go to the receiver, which must outlive the bus. At
  // most `queue` messages wait for poll(), the newest are dropped beyond. Once, at set-up.
  void subscribe(const std::string& channels, int queue, Receiver& receiver);
  // Waits at most `timeout_ms` for a message, then hands over those that wait, at most `max_messages`.
  // Returns how many; -1 when there is no bus.
  [[nodiscard]] int poll(int timeout_ms, int max_messages) noexcept;

  [[nodiscard]] bool isOpen() const noexcept;
  // Why it is not, with the command that gives the machine a multicast route; static storage.
  [[nodiscard]] const char* reason() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Table `[lcm]` of onboard.toml.
struct LcmConfig {
  std::string url;  // provider; empty: no LCM
  // Samples that are taken from the bus instead of from devices, by the place of their type in SensorSample.
  std::array<bool, kDeviceKinds> accept{};
  double max_age_s =
      10;           // a sample stamped further from its arrival is refused; a fix, further back than 300 s
  int queue = 200;  // messages that may wait on the bus
  double publish_hz = 1;  // of pose, 0: none are sent; health, map and link at most once a second
};
// Its keys.
void visitLcm(KeyVisitor& keys, LcmConfig& config);

// Samples that other programs of the vehicle publish: the channels of
// firmware_if/mission/log/log_messages.hpp, and TCM, PAROSCI and USBL_FIX.<vehicle> as ACFR vehicles have
// them. Where a kind of sample comes in both forms the ACFR one, which has microseconds and no CRC, is left
// out. Damaged messages, impossible values and stamps far from now are counted and dropped.
//
// Stamps are UTC by the sender's clock. The difference between vehicle time and the system's UTC (`clock`) is
// added:
// programs of this machine stamp by the system's UTC, and so do those of other machines once this machine's
// clock is synchronised. While it is not, a stamp that fits its arrival only unchanged is taken unchanged.
class LcmSource final : public SampleSource, private LcmBus::Receiver {
 public:
  // A bus that cannot be joined yet is joined by poll(), also where nothing is accepted.
  LcmSource(const LcmConfig& config, std::shared_ptr<LcmBus> bus, const std::string& vehicle_name,
            VehicleTime now, VehicleClockState clock = {});

  bool poll(int timeout_ms, SampleSink& sink) override;
  [[nodiscard]] DeviceHealth health() const override;

 private:
  void message(std::string_view channel, std::span<const std::uint8_t> data) noexcept override;
  [[nodiscard]] bool toVehicleTime(SensorSample& sample, std::int64_t arrival_ns) const noexcept;

  LcmConfig config_;
  std::shared_ptr<LcmBus> bus_;
  VehicleTime now_;
  VehicleClockState clock_;
  SampleSink* sink_ = nullptr;  // during poll()
  bool works_ = true;
  std::array<std::int64_t, kDeviceKinds> last_native_ns_{};  // arrival of each kind's newest fathom message
  std::array<std::uint64_t, kDeviceKinds> taken_{};
  std::int64_t last_sample_ns_ = 0;
  std::uint64_t samples_ = 0, bad_ = 0, stale_ = 0, twins_ = 0, unasked_ = 0, failures_ = 0;
};

// Publishes on the bus; best effort, from one thread.
class LcmPublisher {
 public:
  LcmPublisher(std::shared_ptr<LcmBus> bus, std::string vehicle_name)
      : bus_(std::move(bus)), vehicle_name_(std::move(vehicle_name)) {}

  void publish(const PoseReport& pose) noexcept;     // FATHOM_POSE and <vehicle>.ACFR_NAV
  void publish(const LogMessage& message) noexcept;  // one that was encoded for the log already
  [[nodiscard]] std::uint64_t published() const noexcept { return published_; }
  [[nodiscard]] std::uint64_t refused() const noexcept { return bus_->refused(); }

 private:
  std::shared_ptr<LcmBus> bus_;
  std::string vehicle_name_;
  std::uint64_t published_ = 0;
};

}  // namespace fathom::io
