#include <algorithm>
#include <cmath>

#include "firmware_if/predive/predive_checks.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"

namespace fathom::io {
namespace {

constexpr double kRateTolerance = 0.05;   // of the rate; and one frame at each end
constexpr std::size_t kFewestFrames = 3;  // before there is a rate
constexpr double kPairedShare = 0.9;      // of the frames that must find their partner
constexpr double kDarkFrame = 0.5;        // of the camera's usual brightness: a frame without light
constexpr double kUnlike = 4;             // brightness of one camera over the other's

double rateOf(const std::vector<FrameFacts>& frames) {
  const double time = static_cast<double>(frames.back().utc_ns - frames.front().utc_ns) / 1e9;
  return time > 0 ? static_cast<double>(frames.back().frame_id - frames.front().frame_id) / time : 0;
}

// True when its frames are worth looking at further.
bool checkOne(const PrediveFacts& facts, std::size_t side, const CameraConfig& config,
              const Camera& calibrated, PrediveReport& report) {
  const std::string name = std::string("camera ") + kCameraSides[side];
  const CameraFacts& camera = facts.cameras[side];
  if (!camera.used) {
    report.bad(name, "none is configured",
               std::string("set cameras.") + kCameraSides[side] + " to its serial number in onboard.toml");
    return false;
  }
  const std::string named =
      config.id + (camera.identity.address.empty() ? "" : " at " + camera.identity.address);
  if (camera.frames.empty()) {
    const std::string why = camera.identity.failure.empty() ? "" : ": " + camera.identity.failure;
    if (!camera.identity.answers)
      report.bad(name, named + " is not there" + why,
                 "look at power, cable and address: arv-tool-0.8 lists the cameras that answer");
    else if (!why.empty())
      report.bad(
          name, named + " cannot be used" + why,
          "end programs that use it; look whether it is the other side's, and at [cameras] in onboard.toml");
    else
      report.bad(
          name, named + " answers but gives no frame",
          "look at the trigger and cameras.trigger, then at lost packets (MTU 9000 on the whole path)");
    return false;
  }
  const FrameFacts& frame = camera.frames.back();
  const std::string size = std::to_string(frame.width) + "x" + std::to_string(frame.height);
  if (frame.width != calibrated.width || frame.height != calibrated.height) {
    report.bad(name, named + " gives " + size,
               "stereo.calib is of " + std::to_string(calibrated.width) + "x" +
                   std::to_string(calibrated.height) +
                   ": set cameras.width and height to it, or calibrate again");
    return true;
  }
  const std::uint64_t exposed = frame.frame_id - camera.frames.front().frame_id + 1;
  const std::uint64_t missed = exposed > camera.frames.size() ? exposed - camera.frames.size() : 0;
  const double rate = camera.frames.size() < kFewestFrames ? 0 : rateOf(camera.frames);
  const std::string found = named + ", " + size + ", " + decimals(rate, 2) + " Hz of " +
                            decimals(config.rate_hz, 2) + ", " + std::to_string(camera.frames.size()) +
                            " frames, " + std::to_string(missed) + " missed";
  report.judge(
      name, found,
      {{missed > 0,
        "frames are lost on the network: MTU 9000 on every part of the path, then cameras.packet_delay_ns"},
       {std::abs(rate - config.rate_hz) > kRateTolerance * config.rate_hz,
        "look at the trigger's rate and at cameras.rate_hz; an exposure longer than the period slows it"}});
  return true;
}

void checkImages(const std::vector<FrameFacts>& frames, const std::string& side, const PrediveConfig& limits,
                 PrediveReport& report) {
  std::vector<double> widths, means;
  double saturated = 0;
  for (const FrameFacts& frame : frames) {
    if (frame.quality.edge_width_px > 0) widths.push_back(frame.quality.edge_width_px);
    means.push_back(frame.quality.mean);
    saturated = std::max(saturated, frame.quality.saturated_share);
  }
  const double mean = median(means);
  const std::string light = "mean " + decimals(100 * mean, 1) + " % of full scale, at most " +
                            decimals(100 * saturated, 1) + " % of the pixels saturated";
  report.judge("exposure " + side, light,
               {{mean < limits.mean_min, "too dark: lens cap, strobe, cameras.exposure_us, cameras.gain_db"},
                {mean > limits.mean_max || saturated > limits.saturated_share,
                 "too bright: lower cameras.exposure_us or cameras.gain_db, or the strobe"}});
  if (2 * widths.size() < frames.size()) {
    report.bad("focus " + side, "too few edges to measure",
               "show it something with edges at the distance that it will work at, and light it");
    return;
  }
  const double width = median(widths);
  const std::string found =
      "sharpest edges " + decimals(width, 1) + " px wide, " + decimals(limits.edge_px, 1) + " at most";
  report.judge("focus " + side, found,
               {{!(width <= limits.edge_px), "turn the lens until the edges are sharp; wipe the port"}});
}

struct PairedFrames {
  std::vector<double> offsets_s;  // right after left
  std::size_t wanted = 0;
};

// Each left frame with the right one nearest in time, within half a period.
PairedFrames pairFrames(const std::vector<FrameFacts>& left, const std::vector<FrameFacts>& right,
                        double right_later_s, double period_s) {
  PairedFrames pairs;
  pairs.wanted = std::min(left.size(), right.size());
  for (const FrameFacts& frame : left) {
    double best = period_s;
    for (const FrameFacts& other : right) {
      const double offset = static_cast<double>(other.utc_ns - frame.utc_ns) / 1e9 + right_later_s;
      if (std::abs(offset) < std::abs(best)) best = offset;
    }
    if (std::abs(best) < period_s / 2) pairs.offsets_s.push_back(best);
  }
  return pairs;
}

void checkPair(const PrediveFacts& facts, const StereoCameraConfig& cameras, const MissionConfig& mission,
               const PrediveConfig& limits, PrediveReport& report) {
  const auto& left = facts.cameras[0].frames;
  const auto& right = facts.cameras[1].frames;
  const double later = mission.time_offsets.right_camera - mission.time_offsets.left_camera;
  PairedFrames pairs = pairFrames(left, right, later, 1 / cameras.side[0].rate_hz);
  std::sort(pairs.offsets_s.begin(), pairs.offsets_s.end());
  const std::size_t n = pairs.offsets_s.size();
  if (n < kFewestFrames) {
    report.bad("pair timing", "only " + plural(n, "pair"), "let both cameras run, or look longer: --seconds");
  } else {
    const double middle = pairs.offsets_s[n / 2],
                 spread = pairs.offsets_s[n - 1 - n / 10] - pairs.offsets_s[n / 10];
    const std::string found = "right " + decimals(1e3 * middle, 2) + " ms after left, spread " +
                              decimals(1e3 * spread, 2) + " ms, " + std::to_string(n) + " pairs";
    report.judge(
        "pair timing", found,
        {{std::abs(middle) > limits.pair_offset_s || spread > limits.pair_offset_s ||
              static_cast<double>(n) < kPairedShare * static_cast<double>(pairs.wanted),
          "the cameras do not expose together: trigger both by one line (cameras.trigger = \"line\"), "
          "or by PTP"}});
  }

  std::array<double, 2> usual{};
  std::array<std::size_t, 2> dark{};
  for (std::size_t side = 0; side < 2; ++side) {
    std::vector<double> means;
    for (const FrameFacts& frame : facts.cameras[side].frames) means.push_back(frame.quality.mean);
    // The upper quartile: where every other frame is dark the median says nothing.
    std::sort(means.begin(), means.end());
    usual[side] = means[means.size() - 1 - means.size() / 4];
    for (const double mean : means) dark[side] += mean < kDarkFrame * usual[side] ? 1 : 0;
  }
  const std::string found = "left " + decimals(100 * usual[0], 1) + " %, right " +
                            decimals(100 * usual[1], 1) + " % of full scale; frames without light: left " +
                            std::to_string(dark[0]) + " of " + std::to_string(left.size()) + ", right " +
                            std::to_string(dark[1]) + " of " + std::to_string(right.size());
  report.judge(
      "strobe", found,
      {{dark[0] + dark[1] > 0, "the strobe misses frames: look at its trigger, delay and recharge time"},
       {std::max(usual[0], usual[1]) > kUnlike * std::min(usual[0], usual[1]),
        "one camera is not open when the strobe fires: look at trigger delays, exposure and lens caps"}});
}

}  // namespace

void checkCameras(const PrediveFacts& facts, const StereoCameraConfig& cameras, const MissionConfig& mission,
                  const StereoRig& rig, const PrediveConfig& limits, PrediveReport& report) {
  const std::array<const Camera*, 2> calibrated = {&rig.left, &rig.right};
  std::array<bool, 2> gives{};
  for (std::size_t side = 0; side < 2; ++side)
    gives[side] = checkOne(facts, side, cameras.side[side], *calibrated[side], report);
  const std::string &left = facts.cameras[0].identity.serial, &right = facts.cameras[1].identity.serial;
  if (!left.empty() && !right.empty()) {
    const std::string wrong = serialMismatch(mission, left, right);
    report.judge("serial numbers",
                 "left " + left + ", right " + right + (wrong.empty() ? ", as calibrated" : ""),
                 {{!wrong.empty(), wrong}});
  }
  for (std::size_t side = 0; side < 2; ++side)
    if (gives[side]) checkImages(facts.cameras[side].frames, kCameraSides[side], limits, report);
  if (gives[0] && gives[1]) checkPair(facts, cameras, mission, limits, report);
}

}  // namespace fathom::io
