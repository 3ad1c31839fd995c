#include "firmware_if/devices/camera/camera_config.hpp"

#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

std::string defaultFormat(PixelFormat format, int bits) {
  const std::string colour = format == PixelFormat::kBayerRggb ? "BayerRG" : "Mono";
  return colour + (bits == 8 ? "8" : "12Packed");
}

WireFormat readWireFormat(const ConfigTable& table, const std::string& key, const MissionConfig& mission,
                          PixelFormat format, bool used) {
  std::vector<std::string> names;
  for (const WireFormat& wire : wireFormats()) names.emplace_back(wire.name);
  const WireFormat wire = *wireFormat(table.choice(key, defaultFormat(format, mission.cameras.bits), names));
  // What is recorded is what the mission says, so that it is read again as what it was.
  if (used && (wire.format != format || wire.bits != mission.cameras.bits))
    table.fail(key, std::string(wire.name) + " does not give what mission.toml says of this camera (" +
                        (format == PixelFormat::kBayerRggb ? "bayer-rggb" : "mono") + ", " +
                        std::to_string(mission.cameras.bits) + " bits); correct one of them");
  return wire;
}

}  // namespace

StereoCameraConfig readCameraConfig(const ConfigTable& table, const MissionConfig& mission,
                                    StereoCameraConfig defaults) {
  StereoCameraConfig config = std::move(defaults);
  const std::array<PixelFormat, 2> formats{mission.cameras.left_format, mission.cameras.right_format};
  for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
    CameraConfig& camera = config.side[i];
    const std::string side = kCameraSides[i];
    camera.side = static_cast<CameraSide>(i);
    camera.id = table.text(side, camera.id);
    camera.format = readWireFormat(table, side + "_format", mission, formats[i], !camera.id.empty());
    camera.width = static_cast<int>(table.integer("width", camera.width, 1, 16384));
    camera.height = static_cast<int>(table.integer("height", camera.height, 1, 16384));
    camera.exposure_us = table.number("exposure_us", camera.exposure_us, 0, 10'000'000);
    camera.gain_db = table.number("gain_db", camera.gain_db, -1, 60);
    camera.packet_size = static_cast<int>(table.integer("packet_size", camera.packet_size, 0, 16384));
    if (camera.packet_size != 0 && camera.packet_size < 576)
      table.fail("packet_size", "below 576 bytes no camera sends; give 0 for the largest that fits");
    camera.packet_delay_ns = table.integer("packet_delay_ns", camera.packet_delay_ns, 0, kSecond_ns);
    const std::string trigger = table.choice("trigger", "free-run", {"free-run", "line", "ptp"});
    camera.trigger = trigger == "line"  ? CameraTrigger::kLine
                     : trigger == "ptp" ? CameraTrigger::kPtp
                                        : CameraTrigger::kFreeRun;
    camera.trigger_line = table.text("trigger_line", camera.trigger_line);
    camera.trigger_activation =
        table.choice("trigger_activation", camera.trigger_activation,
                     {"RisingEdge", "FallingEdge", "AnyEdge", "LevelHigh", "LevelLow"});
    camera.rate_hz = table.number("rate_hz", mission.cameras.rate_hz, 0.1, 100);
    camera.buffers =
        static_cast<std::size_t>(table.integer("buffers", static_cast<std::int64_t>(camera.buffers), 2, 64));
    camera.pool_frames = static_cast<std::size_t>(
        table.integer("pool_frames", static_cast<std::int64_t>(camera.pool_frames), 2, 1024));
    camera.interface = table.text("interface", camera.interface);
    camera.packet_socket = table.boolean("packet_socket", camera.packet_socket);
    camera.receive_priority =
        static_cast<int>(table.integer("receive_priority", camera.receive_priority, 0, 98));
    camera.stamp_to_packet_ms = table.number("stamp_to_packet_ms", camera.stamp_to_packet_ms, 0, 1000);
  }
  if (!config.side[0].id.empty() && config.side[0].id == config.side[1].id)
    table.fail("right", "is the same camera as left; give each its own serial number");
  if (config.side[0].id.empty() != config.side[1].id.empty())
    table.fail(config.side[0].id.empty() ? "left" : "right",
               "has no camera where the other side has one; give both serial numbers, or neither");
  return config;
}

std::string serialMismatch(const MissionConfig& mission, const std::string& left, const std::string& right) {
  const std::string& wants_left = mission.cameras.left_serial;
  const std::string& wants_right = mission.cameras.right_serial;
  if (left == wants_left && right == wants_right) return "";
  if (left == wants_right && right == wants_left)
    return "the cameras are swapped: left is " + left + ", right is " + right +
           ", the calibration was made with left " + wants_left + ", right " + wants_right +
           "; swap left and right in [cameras]";
  const bool left_differs = left != wants_left;
  return std::string("the ") + (left_differs ? "left" : "right") + " camera is " +
         (left_differs ? left : right) + " where mission.toml's calibration was made with " +
         (left_differs ? wants_left : wants_right) + "; calibrate again, or correct cameras." +
         (left_differs ? "left_serial" : "right_serial");
}

}  // namespace fathom::io
