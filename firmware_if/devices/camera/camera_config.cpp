#include "firmware_if/devices/camera/camera_config.hpp"

#include <vector>

#include "realtime/base/units.hpp"

namespace fathom::io {
namespace {

std::string defaultFormat(PixelFormat format, int bits) {
  const std::string colour = format == PixelFormat::kBayerRggb ? "BayerRG" : "Mono";
  return colour + (bits == 8 ? "8" : "12Packed");
}

void visitWireFormat(KeyVisitor& keys, const std::string& key, const MissionConfig& mission,
                     PixelFormat format, CameraConfig& camera) {
  std::vector<const char*> names;
  for (const WireFormat& wire : wireFormats()) names.push_back(wire.name.data());
  std::string name =
      keys.reads() ? defaultFormat(format, mission.cameras.bits) : std::string(camera.format.name);
  keys.choiceText(key.c_str(), name, names,
                  "must give what mission.toml says of the pixels; by default its packed 12 bits, or 8");
  camera.format = *wireFormat(name);
  // What is recorded is what the mission says, so that it is read again as what it was.
  keys.require(
      camera.id.empty() || (camera.format.format == format && camera.format.bits == mission.cameras.bits),
      key.c_str(),
      name + " does not give what mission.toml says of this camera (" +
          (format == PixelFormat::kBayerRggb ? "bayer-rggb" : "mono") + ", " +
          std::to_string(mission.cameras.bits) + " bits); correct one of them");
}

// The keys that both cameras share.
void visitBoth(KeyVisitor& keys, CameraConfig& c) {
  constexpr const char* kTriggers[] = {"free-run", "line", "ptp"};
  constexpr const char* kActivations[] = {"RisingEdge", "FallingEdge", "AnyEdge", "LevelHigh", "LevelLow"};
  keys.integer("width", c.width, "px", 1, 16384, "of an image");
  keys.integer("height", c.height, "px", 1, 16384, "of an image");
  keys.number("exposure_us", c.exposure_us, "us", 0, 10'000'000, "0: as the camera has it");
  keys.number("gain_db", c.gain_db, "dB", -1, 60, "below 0: as the camera has it");
  keys.integer("packet_size", c.packet_size, "B", 0, 16384,
               "576 at least; 0: the largest that the network carries, found by test packets");
  keys.require(c.packet_size == 0 || c.packet_size >= 576, "packet_size",
               "below 576 bytes no camera sends; give 0 for the largest that fits");
  keys.integer("packet_delay_ns", c.packet_delay_ns, "ns", 0, kSecond_ns,
               "between packets; two cameras that share a switch need it");
  keys.choiceOf("trigger", c.trigger, kTriggers,
                "line: an edge exposes; ptp: free-run with clocks set by IEEE 1588");
  keys.text("trigger_line", c.trigger_line, "the camera's word");
  keys.choiceText("trigger_activation", c.trigger_activation, kActivations, "the camera's word");
  keys.number("rate_hz", c.rate_hz, "Hz", 0.1, 100,
              "also what silence is measured in; by default that of mission.toml");
  keys.integer("buffers", c.buffers, "frames", 2, 64, "that Aravis fills");
  keys.integer("pool_frames", c.pool_frames, "frames", 2, 1024, "whole ones, held by map and recorder");
  keys.text("interface", c.interface, "network interface to look on; empty: all");
  keys.boolean(
      "packet_socket", c.packet_socket,
      "receive below the UDP stack (CAP_NET_RAW), a little cheaper; only with one camera on the machine");
  keys.integer("receive_priority", c.receive_priority, 0, 98,
               "SCHED_FIFO priority of the receiving thread; 0: ordinary");
  keys.number("stamp_to_packet_ms", c.stamp_to_packet_ms, "ms", 0, 1000,
              "known time from stamp to first packet, for cameras without a latch");
}

}  // namespace

void visitCameras(KeyVisitor& keys, StereoCameraConfig& config, const MissionConfig& mission) {
  const std::array<PixelFormat, 2> formats{mission.cameras.left_format, mission.cameras.right_format};
  auto& [left, right] = config.side;
  for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
    CameraConfig& camera = config.side[i];
    const std::string side = kCameraSides[i];
    camera.side = static_cast<CameraSide>(i);
    keys.text(side.c_str(), camera.id, "serial number, Vendor-serial or IP address; empty: none");
    visitWireFormat(keys, side + "_format", mission, formats[i], camera);
  }
  CameraConfig both = left;
  if (keys.reads()) both.rate_hz = mission.cameras.rate_hz;
  visitBoth(keys, both);
  for (CameraConfig* camera : {&left, &right}) {
    both.side = camera->side;
    both.id = camera->id;
    both.format = camera->format;
    *camera = both;
  }
  keys.require(left.id.empty() || left.id != right.id, "right",
               "is the same camera as left; give each its own serial number");
  keys.require(left.id.empty() == right.id.empty(), left.id.empty() ? "left" : "right",
               "has no camera where the other side has one; give both serial numbers, or neither");
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
