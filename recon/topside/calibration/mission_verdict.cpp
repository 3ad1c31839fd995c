#include <algorithm>
#include <cmath>

#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/calibration/mission_check.hpp"

namespace fathom::topside {
namespace {

using Kind = MissionVerdict::Line::Kind;

constexpr double kCertain = 3;          // standard deviations
constexpr double kMaxRange = 0.03;      // of the ranges; sound speed and tilt account for about 1 %
constexpr double kTooUncertain = 0.06;  // three standard deviations of the ranges' ratio
constexpr double kMaxSpeed = 0.02;      // of the distance travelled; a DVL is good to 0.5 %
constexpr double kMaxMount = 1.0 / kDegreesPerRadian;  // [rad]: moves the seafloor's map by 3.5 cm at 2 m
const char* const kTurnNames[3] = {"roll (about forward)", "pitch (about starboard)", "yaw (about down)"};

std::string pm(double value, double sigma, int digits) {
  return decimals(value, digits) + " +- " + decimals(sigma, digits);
}

// Bad only where it is certain; beyond what is allowed but not certainly so, it stays open.
Kind kindOf(double off, double sigma, double allowed) {
  if (std::abs(off) <= allowed) return Kind::kGood;
  return std::abs(off) > kCertain * sigma ? Kind::kBad : Kind::kOpen;
}

void judgeEpipolar(const MissionCheck& check, MissionVerdict& out) {
  const auto& e = check.epipolar;
  const bool bad = hasMoved(check.epipolar);
  std::string text = "epipolar error median " + decimals(e.median, 2) +
                     " px (allowed 0.5), worst part of the image " + decimals(e.worst_cell, 2) +
                     " px (allowed 0.75) at column " + std::to_string(e.worst_column + 1) + " of 8, row " +
                     std::to_string(e.worst_row + 1) + " of 6";
  if (bad) {
    text += ": the rig has moved; calibrate again. A right camera turned by";
    const char* const names[3] = {" pitch ", ", yaw ", ", roll "};
    for (int i = 0; i < 3; ++i)
      text += names[i] + pm(kDegreesPerRadian * e.rotation(i), kDegreesPerRadian * e.rotation_sigma(i), 4);
    text += " deg, with focal lengths " + pm(100 * e.focal, 100 * e.focal_sigma, 3) +
            " % longer against the left one's, would explain it, but for " + decimals(e.sigma_after, 2) +
            " px a match";
  }
  out.lines.push_back({bad ? Kind::kBad : Kind::kGood, text});
}

void judgeRange(const MissionCheck& check, MissionVerdict& out) {
  const auto& r = check.range;
  if (r.ratio_sigma <= 0) {
    out.lines.push_back({Kind::kOpen, "stereo range against DVL altitude: " + std::to_string(r.samples) +
                                          " places seen by both, at least 8 are needed"});
    return;
  }
  Kind kind = kindOf(r.ratio - 1, r.ratio_sigma, kMaxRange);
  if (kind == Kind::kGood && kCertain * r.ratio_sigma > kTooUncertain) kind = Kind::kOpen;
  const bool bad = kind == Kind::kBad;
  std::string text = "stereo range is " + pm(r.ratio, r.ratio_sigma, 4) +
                     " of the DVL's (allowed 1 +- 0.03) over " + decimals(r.shortest, 2) + " to " +
                     decimals(r.longest, 2) + " m";
  if (r.line_known)
    text += "; scale " + pm(r.scale, r.scale_sigma, 4) + ", offset " + pm(r.offset, r.offset_sigma, 3) + " m";
  else
    text += "; scale and offset cannot be distinguished at one altitude";
  constexpr double kRefraction = 1.33, kNear = 0.06;  // index of sea water
  if (bad && (std::abs(r.ratio * kRefraction - 1) < kNear || std::abs(r.ratio / kRefraction - 1) < kNear))
    text += ": as of a flat port whose refraction one side leaves out (mission.toml says " + check.port +
            "); calibrate in water";
  else if (bad)
    text += ": focal length, baseline or toe-in are wrong; calibrate again";
  if (kind == Kind::kOpen) text += ": too uncertain to tell; fly longer, or over itself";
  out.lines.push_back({kind, text});
}

void judgeSpeed(const MissionCheck& check, MissionVerdict& out) {
  const auto& m = check.mount;
  if (!m.both.known || m.speed_ratio_sigma <= 0) return;
  const Kind kind = kindOf(m.speed_ratio - 1, m.speed_ratio_sigma, kMaxSpeed);
  std::string text =
      "distance seen is " + pm(m.speed_ratio, m.speed_ratio_sigma, 4) + " of the DVL's (allowed 1 +- 0.02)";
  if (hasMoved(check.epipolar)) {
    out.lines.push_back({Kind::kOpen, text + ": not reliable while the rig has moved"});
    return;
  }
  if (kind == Kind::kBad) text += ": the baseline's length or the speed of sound is wrong";
  out.lines.push_back({kind, text});
}

void judgeMount(const MissionCheck& check, MissionVerdict& out) {
  const auto& m = check.mount;
  if (!m.both.known) {
    out.lines.push_back({Kind::kOpen, "camera's mounting: " + std::to_string(m.steps) +
                                          " steps between images could be followed, at least 8 are needed"});
    return;
  }
  for (int i = 0; i < 3; ++i) {
    const double angle = m.both.rotation(i), sigma = m.both.sigma(i);
    if (!std::isfinite(sigma) || kCertain * sigma > 3 * kMaxMount) {
      out.lines.push_back(
          {Kind::kOpen,
           std::string("camera's ") + kTurnNames[i] + " is not observable from this mission: " +
               (i == 0 ? "turns, or rolling, would show it" : "a straight line at speed would show it")});
      continue;
    }
    const Kind kind = kindOf(angle, sigma, kMaxMount);
    std::string text = std::string("camera's ") + kTurnNames[i] + " against DVL and compass is " +
                       pm(kDegreesPerRadian * angle, kDegreesPerRadian * sigma, 2) +
                       " deg off mission.toml's (allowed 1)";
    if (kind == Kind::kBad) text += ": correct extrinsics.T_body_cam";
    if (kind == Kind::kOpen) text += ": too uncertain to tell; fly longer, with turns";
    out.lines.push_back({kind, text});
  }
}

}  // namespace

const char* nameOf(Kind kind) {
  return kind == Kind::kGood ? "good" : kind == Kind::kBad ? "BAD" : "open";
}

MissionVerdict judge(const MissionCheck& check) {
  MissionVerdict out;
  judgeEpipolar(check, out);
  judgeRange(check, out);
  judgeSpeed(check, out);
  judgeMount(check, out);
  out.good =
      std::none_of(out.lines.begin(), out.lines.end(), [](const auto& l) { return l.kind == Kind::kBad; });
  return out;
}

}  // namespace fathom::topside
