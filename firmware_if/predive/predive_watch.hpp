#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "firmware_if/devices/camera/camera_source.hpp"
#include "firmware_if/devices/sample_source.hpp"
#include "firmware_if/devices/vehicle_time.hpp"
#include "realtime/kernel/frame_port.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/geometry/sensor_samples.hpp"

namespace fathom::io {

// Light and focus of one image before a dive. Shares of full scale, 0 to 1.
struct ImageQuality {
  double mean = 0;
  double dark_share = 0;       // of the pixels, below 2 % of full scale
  double saturated_share = 0;  // at 99 % and above
  // Width of the sharpest strong edges [px]: grey levels from one side to the other over the steepest slope
  // between them, the sharpest tenth of all found along rows and columns. A step between two pixels gives 2;
  // an edge blurred by a Gaussian of standard deviation s gives s sqrt(2 pi) and a little more. Independent
  // of contrast; noise counts as no edge (slopes below 10 times that of the noise). Bayer images are looked
  // at in blocks of 2 x 2. 0 when there are fewer than kFewestEdges edges.
  double edge_width_px = 0;
  int edges = 0;
  static constexpr int kFewestEdges = 50;
};

// After Marziliano et al., "A no-reference perceptual blur metric", ICIP 2002: edges' widths along lines.
[[nodiscard]] ImageQuality measureImage(const ImageView& image);

// What a camera says of itself.
struct PrediveIdentity {
  std::string serial, address;
  std::string failure;   // why it could not be opened last, or ""
  bool answers = false;  // it is there, whether it could be opened or not
};

// The acoustic link's protocol, which is of another layer: the program's main gives it.
struct PrediveLink {
  struct Received {
    bool ours = false;  // of the ship, for this vehicle on this dive
    std::optional<UsblFix> fix;
  };
  std::function<Received(std::span<const std::uint8_t>)> read;
  // Writes a frame that gives the ship the turn to speak; the bytes used.
  std::function<std::size_t(std::int64_t utc_ns, std::span<std::uint8_t> out)> greet;
};

// The devices that are checked: the program's own before a dive, stand-ins in tests.
struct PrediveDevices {
  struct Camera {
    std::unique_ptr<CameraSource> source;       // null: none is configured
    std::function<PrediveIdentity()> identity;  // on the thread that polled, afterwards
  };
  std::array<Camera, 2> cameras;  // by CameraSide
  std::vector<std::unique_ptr<SampleSource>> sources;
  // Kinds of samples, by the place in SensorSample, that the configuration takes from somewhere.
  std::array<bool, kDeviceKinds> expected{};
  bool modem_used = false;
  std::unique_ptr<FramePort> modem;  // null: none, or it could not be opened
  std::string modem_failure;
  PrediveLink link;
};

struct FrameFacts {
  std::uint64_t frame_id = 0;
  std::int64_t utc_ns = 0, device_ns = 0;
  int width = 0, height = 0;  // [px]
  ImageQuality quality;
};
struct CameraFacts {
  bool used = false;
  PrediveIdentity identity;
  std::vector<FrameFacts> frames;
  DeviceHealth health;
};
struct SampleFacts {
  std::uint64_t count = 0;
  std::int64_t first_ns = 0, last_ns = 0;  // arrival
  double longest_gap_s = 0;
  std::uint64_t usable = 0;  // DVL: with velocity; the others: all
  SensorSample last;
  [[nodiscard]] double rateHz() const {
    return count < 2 || last_ns <= first_ns
               ? 0
               : static_cast<double>(count - 1) * 1e9 / static_cast<double>(last_ns - first_ns);
  }
};
struct ModemFacts {
  bool used = false, open = false;
  std::string failure;
  std::uint64_t frames = 0, ours = 0, broken = 0;
  std::optional<UsblFix> fix;  // the newest
};
struct PrediveFacts {
  double seconds = 0;  // looked at
  std::array<CameraFacts, 2> cameras;
  std::array<SampleFacts, kDeviceKinds> samples;  // by the place in SensorSample
  std::array<bool, kDeviceKinds> expected{};
  std::vector<DeviceHealth> sources;
  ModemFacts modem;
};

// Polls every device from a thread of its own while `more` says so, which every thread asks between two
// polls, and notes what it gives. Cameras' frames go back to their pools at once.
[[nodiscard]] PrediveFacts watchDevices(PrediveDevices& devices, const std::function<bool()>& more,
                                        const VehicleTime& now);

}  // namespace fathom::io
