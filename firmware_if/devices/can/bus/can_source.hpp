#pragma once

#include <optional>
#include <string>

#include "firmware_if/devices/can/bus/socket_can.hpp"
#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/can/raw_can.hpp"
#include "firmware_if/devices/can/samples/n2k_samples.hpp"
#include "firmware_if/devices/can/send/can_sender.hpp"
#include "firmware_if/devices/sample_source.hpp"
#include "realtime/base/config_keys.hpp"
#include "realtime/base/config_table.hpp"
#include "realtime/kernel/rings/broadcast_ring.hpp"

namespace fathom::io {

// The `[can]` table of onboard.toml, with `[can.send]`; keys, units and ranges are in the folder's README.
struct CanConfig {
  std::string interface;       // empty: no CAN
  N2kSamples::Config samples;  // latitude is the mission's: the caller sets it
  bool send = false;           // the vehicle's position and the map's state to others on the bus
  CanSender::Config sender;    // software_version: the caller sets it
};

// Its keys.
void visitCan(KeyVisitor& keys, CanConfig& config);

// The vehicle's NMEA 2000 bus: compass, depth, battery, GPS and water as samples, every frame raw ("RAW_CAN",
// firmware_if/devices/can/raw_can.hpp), errors of the bus counted. Samples carry the time of reception as
// both their time and their arrival; what a device needs to measure and send is in mission.toml's time
// offsets.
class CanSource final : public SampleSource {
 public:
  // `vehicle`: its utcNs() is vehicle time, which never steps; outlives this. Throws InputError for an
  // interface name that cannot be one; an interface that is not there yet is waited for by poll().
  CanSource(const CanConfig& config, const rt::Clock& vehicle);

  bool poll(int timeout_ms, SampleSink& sink) override;
  // What poll() sends from now on, where sending is enabled; from one thread, any. To be renewed at least
  // every CanSender::kReportHolds_s.
  void publish(const VehicleReport& report) noexcept;
  [[nodiscard]] DeviceHealth health() const override;

 private:
  void take(const BusFrame& frame, SampleSink& sink) noexcept;
  void flushRaw(SampleSink& sink) noexcept;
  void sendWhatIsDue() noexcept;

  const rt::Clock& vehicle_;
  SocketCan socket_;
  N2kDecoder decoder_;
  N2kSamples samples_;
  RawCanWriter raw_;
  std::optional<CanSender> sender_;
  rt::LatestValue<VehicleReport> reports_;
  std::optional<std::uint64_t> started_at_disconnects_;  // when the sender was last started
  std::int64_t last_data_ns_ = 0;
};

}  // namespace fathom::io
