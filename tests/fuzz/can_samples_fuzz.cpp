// Frames of every parameter group that gives samples, from a few addresses, with any bytes: every sample is
// of finite numbers within its bounds, and the sender that receives the same frames sends what it may and no
// more.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <variant>

#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/can/n2k_definitions.hpp"
#include "firmware_if/devices/can/raw_can.hpp"
#include "firmware_if/devices/can/samples/n2k_samples.hpp"
#include "firmware_if/devices/can/send/can_sender.hpp"
#include "firmware_if/devices/can/send/n2k_encoder.hpp"

namespace {

using namespace fathom;
using namespace fathom::io;

void need(bool good) {
  if (!good) std::abort();
}

struct Check {
  void operator()(const AttitudeSample& s) const {
    need(s.heading >= 0 && s.heading < 6.2832 && std::abs(s.roll) < 3.3 && std::abs(s.pitch) < 3.3);
  }
  void operator()(const GyroSample& s) const {
    need(!s.body_rate && s.heading_rate && std::abs(*s.heading_rate) < 67.2);
  }
  void operator()(const DepthSample& s) const { need(std::isfinite(s.depth)); }
  void operator()(const GpsFix& s) const {
    need(std::abs(s.latitude) < 1.5708 && std::abs(s.longitude) < 3.1416 && s.sigma_horizontal > 0);
  }
  void operator()(const WaterSample& s) const {
    need(s.temperature && std::isfinite(*s.temperature));
    need(!s.sound_speed || (*s.sound_speed > 1300 && *s.sound_speed < 1800));
  }
  void operator()(const BatterySample& s) const {
    need(!s.voltage || std::isfinite(*s.voltage));
    need(!s.charge || (*s.charge >= 0 && *s.charge <= 1));
  }
  template <class Other>
  void operator()(const Other&) const {
    std::abort();
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::array<std::uint32_t, 14> kPgns = {59904,  60928,  127250, 127251, 127257, 127506, 127508,
                                                   128267, 129025, 129029, 130312, 130314, 130316, 130321};
  if (size == 0) return 0;
  N2kSamples::Config config;
  config.depth_from = static_cast<N2kSamples::DepthFrom>(data[0] % 3);
  config.message_variation = (data[0] & 4) != 0;
  config.salinity_psu = 35;
  N2kDecoder decoder({.slots = 4, .timeout_ns = 750'000'000});
  N2kSamples samples(config);
  CanSender sender({});
  sender.start();
  std::int64_t utc_ns = 1'700'000'000'000'000'000;
  // Eleven bytes a frame: which PGN, source and size, time step, data.
  for (++data, --size; size >= 11; data += 11, size -= 11) {
    CanFrame frame;
    const std::array<std::uint8_t, 4> addresses = {7, 120, 121, 250};
    frame.id = makeN2kId({3, kPgns[data[0] % kPgns.size()], addresses[data[1] & 3], addresses[data[1] >> 6]});
    frame.size = static_cast<std::uint8_t>(std::min(data[1] >> 2 & 15, 8));
    utc_ns += data[2] * std::int64_t{10'000'000};
    frame.utc_ns = utc_ns;
    std::copy_n(data + 3, 8, frame.data.begin());
    if (const N2kMessage* message = decoder.add(frame))
      for (const SensorSample& sample : samples.add(*message)) std::visit(Check{}, sample);
    sender.receive(frame, utc_ns);
    VehicleReport report;
    report.utc_ns = utc_ns;
    report.latitude = report.longitude = report.depth = 1;
    sender.publish(report);
    for (int i = 0; i < 100; ++i) {
      const CanFrame* out = sender.next(utc_ns);
      if (out == nullptr) break;
      need(i < 60);  // bounded by the rate
      const std::uint32_t pgn = parseN2kId(out->id).pgn;
      need(pgn == 130900 || std::ranges::count(CanSender::kSentPgns, pgn) == 1);
      sender.sent(utc_ns);
    }
  }
  // What is left, as a log's entry.
  std::span<const std::uint8_t> raw(data, size);
  RawCanRecord record;
  while (readRawCan(raw, utc_ns, record)) need(record.frame.size <= 8);
  return 0;
}
