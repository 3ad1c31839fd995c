#include "sim/hil/hil_compare.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "sim/hil/bench/child_process.hpp"
#include "sim/hil/fault_table.hpp"
#include "sim/hil/hil_folder.hpp"

namespace fathom::sim {
namespace {

constexpr double kPoseTolerance_m = 0.003;  // of a camera position, without the motion of the whole
constexpr double kPairTolerance_s = 0.025;  // nav.max_pair_skew_s, and the error of the clock mapping
constexpr double kSamePose_s = 0.1;         // between a live pair and the direct replay's
constexpr std::int64_t kSameExposureNs = 50'000'000;
constexpr double kReplay_s = 7200;  // longest that a replay may take
// Files with measured times, which differ between a run and its replay.
const std::set<std::string> kMeasured = {"timing.json", "live.json"};

nlohmann::json readJson(const std::filesystem::path& path) {
  std::ifstream file(path);
  nlohmann::json json = nlohmann::json::parse(file, nullptr, false);
  if (!file || json.is_discarded())
    throw InputError(path.string(), "", "cannot be read; give the folder of a complete bench run");
  return json;
}

bool sameBytes(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::ifstream left(a, std::ios::binary), right(b, std::ios::binary);
  std::array<char, 65536> x{}, y{};
  while (left && right) {
    left.read(x.data(), x.size());
    right.read(y.data(), y.size());
    if (left.gcount() != right.gcount() || !std::equal(x.begin(), x.begin() + left.gcount(), y.begin()))
      return false;
  }
  return left.eof() && right.eof();
}

// Runs fathom-onboard --replay unless its output exists. False for a mission without anything to map.
[[nodiscard]] bool replay(const HilComparison& comparison, const std::filesystem::path& mission,
                          const std::filesystem::path& out, const char* name) {
  if (std::filesystem::exists(out / "report.json")) return true;
  std::fprintf(stderr, "replaying %s\n", mission.c_str());
  ChildProcess::Options child;
  child.argv = {comparison.onboard,
                "--replay",
                mission.string(),
                "--out",
                out.string(),
                "--config",
                HilFolder(comparison.run).config().string()};
  child.output = out.string() + ".log";
  ChildProcess program(child);
  const auto status = program.wait(kReplay_s);
  if (status == kExitBadInput) return false;
  if (status != 0)
    throw std::runtime_error("the replay of the " + std::string(name) + " failed; see " +
                             child.output.string());
  return true;
}

// Times without a vehicle process: from a second before a kill, whose recording may be lost, until its
// cameras are reconnected (a camera waits 3 s for a dead program's heartbeat).
struct Outage {
  std::int64_t from_ns, until_ns;
};
std::vector<Outage> outagesOf(const nlohmann::json& run) {
  constexpr std::int64_t kBefore_ns = kSecond_ns, kCameras_ns = 5'000'000'000;
  std::vector<Outage> all;
  if (run.contains("away"))
    for (const auto& a : run["away"])
      all.push_back({a["from_utc_ns"].get<std::int64_t>() - kBefore_ns,
                     a["until_utc_ns"].get<std::int64_t>() + kCameras_ns});
  return all;
}

struct Recorded {
  std::size_t sent_whole = 0;     // exposures with every packet received, at once or resent
  std::size_t during_outage = 0;  // of these, not recorded during outages
  std::size_t recorded = 0;       // files in img/
  std::size_t unknown = 0;        // files without an exposure
  std::size_t other_pixels = 0;   // files with other pixels than the mission's
};

// Compares recorded files with what one camera sent and with the mission's images, and adds to the counts.
void checkRecording(const HilComparison& comparison, CameraSide side, const std::vector<CameraLogRow>& log,
                    const FaultTable& table, const std::vector<Outage>& outages, Recorded& r) {
  std::set<std::int64_t> missing;
  for (const CameraLogRow& row : log) {
    if (!table.arrivedComplete(side, row)) continue;
    ++r.sent_whole;
    for (const Outage& a : outages)
      if (row.exposed_utc_ns >= a.from_ns && row.exposed_utc_ns <= a.until_ns)
        missing.insert(row.exposed_utc_ns);
  }
  const io::MissionPaths live(HilFolder(comparison.run).mission()), played(comparison.mission);
  const io::MissionConfig::Cameras cameras = io::readMissionConfig(comparison.mission).cameras;
  const PixelFormat format = side == CameraSide::kLeft ? cameras.left_format : cameras.right_format;
  if (!std::filesystem::is_directory(live.images())) return;
  for (const auto& entry : std::filesystem::directory_iterator(live.images())) {
    const auto name = io::parseImageFileName(entry.path().filename().string());
    if (!name || name->side != side) continue;
    ++r.recorded;
    const CameraLogRow* row = exposureAt(log, name->utc_ns);
    if (row == nullptr) {
      ++r.unknown;
      continue;
    }
    missing.erase(row->exposed_utc_ns);
    const io::ImageFile got = io::readImage(entry.path(), format, cameras.bits);
    const io::ImageFile sent = io::readImage(played.images() / row->file, format, cameras.bits);
    r.other_pixels += got.bytes != sent.bytes ? 1 : 0;
  }
  r.during_outage += missing.size();
}

}  // namespace

std::vector<std::string> differingFiles(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::set<std::string> names;
  for (const auto& folder : {a, b})
    if (std::filesystem::is_directory(folder))
      for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
        if (entry.is_regular_file()) names.insert(std::filesystem::relative(entry.path(), folder).string());
  std::vector<std::string> differing;
  for (const std::string& name : names)
    if (kMeasured.count(name) == 0 && !(std::filesystem::exists(a / name) &&
                                        std::filesystem::exists(b / name) && sameBytes(a / name, b / name)))
      differing.push_back(name);
  return differing;
}

double TimeShift::missionUtc(double vehicle_utc_s) const {
  const double since_s = vehicle_utc_s - static_cast<double>(start_utc_ns) * 1e-9;
  return static_cast<double>(mission_begin_utc_ns) * 1e-9 + since_s * rate;
}

PoseDistances comparePoses(const io::StereoPoseFile& live, const io::StereoPoseFile& direct,
                           const TimeShift& shift) {
  std::map<double, const io::StereoPose*> by_time;
  for (const io::StereoPose& pose : direct.poses) by_time[pose.utc_s] = &pose;
  PoseDistances d;
  std::vector<std::pair<SE3, SE3>> pairs;  // live, direct
  for (const io::StereoPose& pose : live.poses) {
    const double utc_s = shift.missionUtc(pose.utc_s);
    const io::StereoPose* nearest = nullptr;
    for (auto it = by_time.lower_bound(utc_s - kSamePose_s);
         it != by_time.end() && it->first <= utc_s + kSamePose_s; ++it)
      if (nearest == nullptr || std::abs(it->first - utc_s) < std::abs(nearest->utc_s - utc_s))
        nearest = it->second;
    if (nearest == nullptr)
      ++d.unmatched;
    else
      pairs.emplace_back(pose.T_nav_cam, nearest->T_nav_cam);
  }
  d.matched = pairs.size();
  if (pairs.empty()) return d;

  // Least-squares rotation about the vertical and translation from direct to live poses.
  const auto count = static_cast<double>(pairs.size());
  Eigen::Vector3d live_mean = Eigen::Vector3d::Zero(), direct_mean = Eigen::Vector3d::Zero();
  for (const auto& [a, b] : pairs) {
    live_mean += a.translation() / count;
    direct_mean += b.translation() / count;
  }
  double sine = 0, cosine = 0;
  for (const auto& [a, b] : pairs) {
    const Eigen::Vector2d to = (a.translation() - live_mean).head<2>(),
                          from = (b.translation() - direct_mean).head<2>();
    sine += from.x() * to.y() - from.y() * to.x();
    cosine += from.dot(to);
  }
  d.turn_rad = std::atan2(sine, cosine);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(d.turn_rad, Eigen::Vector3d::UnitZ()));
  const SE3 motion(turn, live_mean - turn * direct_mean);

  double squares = 0;
  for (const auto& [a, b] : pairs) {
    const SE3 moved = motion * b, between = a.inverse() * moved;
    const double distance = between.translation().norm();
    d.worst_m = std::max(d.worst_m, distance);
    squares += distance * distance;
    d.worst_rad = std::max(d.worst_rad, Eigen::AngleAxisd(between.rotation()).angle());
    d.moved_m = std::max(d.moved_m, (moved.translation() - b.translation()).norm());
  }
  d.rms_m = std::sqrt(squares / count);
  return d;
}

const CameraLogRow* exposureAt(const std::vector<CameraLogRow>& log, std::int64_t utc_ns) {
  const CameraLogRow* nearest = nullptr;
  const auto off = [&](const CameraLogRow& row) { return std::abs(row.exposed_utc_ns - utc_ns); };
  // In the order of exposures, except for those delayed by skew.
  const auto from =
      std::lower_bound(log.begin(), log.end(), utc_ns - 20 * kSameExposureNs,
                       [](const CameraLogRow& row, std::int64_t t) { return row.exposed_utc_ns < t; });
  for (auto it = from; it != log.end() && it->exposed_utc_ns < utc_ns + 20 * kSameExposureNs; ++it)
    if (off(*it) <= kSameExposureNs && (nearest == nullptr || off(*it) < off(*nearest))) nearest = &*it;
  return nearest;
}

PairCheck checkPairs(const io::StereoPoseFile& live, const std::vector<CameraLogRow>& left,
                     const std::vector<CameraLogRow>& right, double tolerance_s) {
  PairCheck check;
  for (const io::StereoPose& pose : live.poses) {
    ++check.pairs;
    const auto left_name = io::parseImageFileName(pose.left_image);
    const auto right_name = io::parseImageFileName(pose.right_image);
    const CameraLogRow* l = left_name ? exposureAt(left, left_name->utc_ns) : nullptr;
    const CameraLogRow* r = right_name ? exposureAt(right, right_name->utc_ns) : nullptr;
    if (l == nullptr || r == nullptr)
      ++check.unknown;
    else if (std::abs(static_cast<double>(l->exposed_utc_ns - r->exposed_utc_ns)) > tolerance_s * 1e9)
      ++check.mismatched;
  }
  return check;
}

bool compareHil(const HilComparison& comparison) {
  const HilFolder folder(comparison.run);
  const nlohmann::json run = readJson(folder.report());
  if (!run.contains("start_utc_ns"))
    throw InputError(folder.report().string(), "", "is of an unfinished run");
  const std::filesystem::path live_folder = folder.mission() / "onboard";
  const nlohmann::json live = readJson(live_folder / "live.json"),
                       report = readJson(live_folder / "report.json");
  const std::vector<CameraLogRow> left = readCameraLog(folder.camera(CameraSide::kLeft, "csv"));
  const std::vector<CameraLogRow> right = readCameraLog(folder.camera(CameraSide::kRight, "csv"));
  const FaultScript script =
      run.contains("faults") ? readFaultScript(run["faults"].get<std::string>()) : FaultScript{};

  const bool replayed = replay(comparison, folder.mission(), folder.replay(), "recording");
  if (!replay(comparison, comparison.mission, folder.direct(), "mission"))
    throw InputError(comparison.mission.string(), "", "gives no map; play a mission that has pictures");

  nlohmann::ordered_json out;
  bool good = true;
  const auto check = [&](const char* name, bool holds, const std::string& text) {
    std::printf("%-8s %-4s %s\n", name, holds ? "good" : "BAD", text.c_str());
    out["checks"][name] = {{"good", holds}, {"text", text}};
    good = good && holds;
  };

  const std::vector<std::string> differing =
      replayed ? differingFiles(live_folder, folder.replay()) : std::vector<std::string>{"everything"};
  std::string names;
  for (const std::string& name : differing) names += " " + name;
  // Images that the map used but a full disk refused cannot be replayed.
  const std::uint64_t stopped = FaultTable::counter(live, {"recorder", "images_dropped_disk"});
  if (stopped > 0 && !differing.empty())
    names += " (images that a full disk refused are missing: not required)";
  check("replay", differing.empty() || stopped > 0,
        differing.empty() ? "the recording replays to identical bytes"
                          : "the replay of the recording differs in" + names);

  const io::StereoPoseFile live_poses = io::readStereoPoses(live_folder / "stereo_pose_est.data");
  const TimeShift shift = {run["start_utc_ns"], run["mission_begin_utc_ns"], run["rate"]};
  // These faults must not change the poses.
  const bool harmless = std::ranges::all_of(script.faults, [](const Fault& f) {
    return f.kind == FaultKind::kMapperKilled || f.kind == FaultKind::kMapperStopped;
  });
  const PoseDistances d =
      comparePoses(live_poses, io::readStereoPoses(folder.direct() / "stereo_pose_est.data"), shift);
  const double sigma_m = report["health"]["slam_position_sigma_m"];
  check("poses", d.matched > 0 && (!harmless || (d.worst_m <= kPoseTolerance_m && d.moved_m <= sigma_m)),
        formatted("%zu camera positions against the direct replay: rms %.1f mm, worst %.1f mm, %.3f deg; "
                  "common motion %.1f mm and %.3f deg (stated sigma: %.0f mm); %zu without counterpart%s",
                  d.matched, 1e3 * d.rms_m, 1e3 * d.worst_m, radiansToDegrees(d.worst_rad), 1e3 * d.moved_m,
                  radiansToDegrees(d.turn_rad), 1e3 * sigma_m, d.unmatched,
                  harmless ? "" : " (the faults' effect)"));
  out["poses"] = {{"matched", d.matched},  {"unmatched", d.unmatched}, {"rms_m", d.rms_m},
                  {"worst_m", d.worst_m},  {"worst_rad", d.worst_rad}, {"moved_m", d.moved_m},
                  {"turn_rad", d.turn_rad}};

  const double navigating_s = live["start"]["navigating_s"];
  check("start", navigating_s > 0,
        formatted("after the program's start: armed %.1f s, navigating %.1f s, first pair mapped %.1f s",
                  live["start"]["armed_s"].get<double>(), navigating_s,
                  live["start"]["first_pair_s"].get<double>()));

  FaultTable table(script, run, live, report, left, right);
  const std::vector<Outage> outages = outagesOf(run);
  Recorded images;
  checkRecording(comparison, CameraSide::kLeft, left, table, outages, images);
  checkRecording(comparison, CameraSide::kRight, right, table, outages, images);
  check("frames", images.recorded + stopped + images.during_outage == images.sent_whole,
        formatted("%zu exposures, %zu sent completely, %zu recorded, %llu refused by a full disk, %zu during "
                  "outages of the program",
                  left.size() + right.size(), images.sent_whole, images.recorded,
                  static_cast<unsigned long long>(stopped), images.during_outage));
  const PairCheck pairs = checkPairs(live_poses, left, right, kPairTolerance_s);
  check(
      "pairs",
      pairs.pairs > 0 && pairs.mismatched + pairs.unknown + images.unknown + images.other_pixels == 0,
      formatted(
          "%zu pairs mapped: %zu mismatched, %zu unknown; %zu recorded images unknown, %zu with other pixels",
          pairs.pairs, pairs.mismatched, pairs.unknown, images.unknown, images.other_pixels));
  out["frames"] = {{"exposures", left.size() + right.size()},
                   {"sent_whole", images.sent_whole},
                   {"recorded", images.recorded},
                   {"stopped_by_disk", stopped},
                   {"while_away", images.during_outage},
                   {"pairs", pairs.pairs},
                   {"mismatched", pairs.mismatched + pairs.unknown},
                   {"other_pixels", images.other_pixels}};

  if (!script.faults.empty()) {
    const bool counted = table.print(stdout);
    check("faults", counted, counted ? "every fault has its count" : "see the table");
    out["faults"] = table.json();
  }
  writeFile(folder.comparison(), out.dump(2) + "\n");
  return good;
}

}  // namespace fathom::sim
