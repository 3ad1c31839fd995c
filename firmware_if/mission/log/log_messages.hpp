#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// Samples as LCM messages: which channel and type carries what.
//
//   channel               type                        holds
//   RDI                   fathom.dvl_t                DvlSample
//   FATHOM_ATTITUDE       fathom.attitude_t           AttitudeSample   (beside it: TCM, senlcm.tcm_t)
//   FATHOM_GYRO           fathom.gyro_t               GyroSample
//   FATHOM_DEPTH          fathom.depth_t              DepthSample      (beside it: PAROSCI, senlcm.parosci_t)
//   FATHOM_USBL           fathom.usbl_t               UsblFix
//                                                       (beside it: USBL_FIX.<vehicle>, senlcm.usbl_fix_t)
//   FATHOM_GPS            fathom.gps_t                GpsFix
//   FATHOM_WATER          fathom.water_t              WaterSample
//   FATHOM_BATTERY        fathom.battery_t            BatterySample
//   FATHOM_PROGRESS       fathom.progress_t           MissionProgressSample
//   FATHOM_IMAGE          fathom.image_t              ImageEvent
//                                                       (beside it: ACFR_AUV_VIS_RAWLOG,
//                                                       acfrlcm.auv_vis_rawlog_t)
//   RAW_DVL, RAW_CAN...   fathom.raw_t                bytes off a device
//
// The fathom types keep nanoseconds, absence and a CRC; the ACFR types beside them are for the ACFR's tools
// and are read only from logs that hold no fathom sample.
struct LogMessage {
  std::string channel;
  std::vector<std::uint8_t> data;
};

[[nodiscard]] LogMessage encodeSample(std::int64_t arrival_utc_ns, const SensorSample& sample);
// The ACFR message beside it; std::nullopt for samples that have none. `vehicle_name` ends the USBL channel's
// name.
[[nodiscard]] std::optional<LogMessage> encodeAcfrTwin(const SensorSample& sample,
                                                       const std::string& vehicle_name);
[[nodiscard]] std::vector<std::uint8_t> encodeRaw(std::int64_t arrival_utc_ns,
                                                  std::span<const std::uint8_t> bytes);

enum class ChannelKind { kSample, kAcfr, kRaw, kOther };
[[nodiscard]] ChannelKind channelKind(std::string_view channel);

struct DecodedSample {
  std::int64_t arrival_utc_ns = 0;
  SensorSample sample;
};
// std::nullopt for a message with a wrong fingerprint, length or CRC, or an image name that is no plain file
// name.
[[nodiscard]] std::optional<DecodedSample> decodeSample(std::string_view channel,
                                                        std::span<const std::uint8_t> data);
// A sample of an ACFR vehicle's own log, which has microseconds; its arrival is the event's time.
[[nodiscard]] std::optional<DecodedSample> decodeAcfr(std::string_view channel, std::int64_t timestamp_us,
                                                      std::span<const std::uint8_t> data);

struct RawBytes {
  std::int64_t arrival_utc_ns = 0;
  std::span<const std::uint8_t> bytes;  // into the message
};
[[nodiscard]] std::optional<RawBytes> decodeRaw(std::span<const std::uint8_t> data);

}  // namespace fathom::io
