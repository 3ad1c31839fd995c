#include "sim/score/score.hpp"

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>

#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/pose_files.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/geometry/ply.hpp"
#include "sim/score/colour_score.hpp"
#include "sim/score/surface_score.hpp"
#include "sim/score/trajectory_score.hpp"

namespace fathom::sim {
namespace {

// Scores the estimates of each program against the truth of one mission.
class Scorer {
 public:
  Scorer(const std::filesystem::path& mission, ScoreReport& report)
      : paths_(mission),
        config_(io::readMissionConfig(trueFolder())),
        truth_(paths_.truth()),
        report_(report) {}

  void scoreDeadReckoning() {
    const auto file = paths_.onboard() / "odometry.csv";
    if (!existsOrNote(file)) return;
    report_.dead_reckoning = scoreOdometry(io::readTrajectory(file), truth_);
    if (!report_.dead_reckoning) note(file, "shares no time with the truth");
  }

  void scoreProgram(const std::filesystem::path& folder, const char* mesh_name,
                    std::optional<TrajectoryScore>& trajectory, std::optional<SurfaceScore>& surface) {
    start_ = SE3();
    const auto poses = folder / "stereo_pose_est.data";
    if (existsOrNote(poses)) {
      const CameraTracks tracks = pairTracks(io::readStereoPoses(poses), truth_, config_);
      if (tracks.truth.empty()) {
        note(poses, "shares no time with the truth");
      } else {
        trajectory = scoreTrack(tracks);
        if (const auto sure = folder / "pose_covariances.csv"; std::filesystem::exists(sure))
          scoreCovariances(tracks, io::readPoseCovariances(sure), *trajectory);
        start_ = alignLevel(tracks.estimate, tracks.truth);
      }
    }
    const auto file = folder / mesh_name;
    if (!existsOrNote(file)) return;
    const Mesh mesh = readPly(file);
    if (sampleSurface(mesh, 1).empty()) {
      note(file, "has no surface");
      return;
    }
    prepareSurface();
    surface = scoreSurface(mesh, *surface_, seen_, start_);
    alignment_ = surface->alignment;
    addColours(mesh_name, colouredPoints(mesh));
  }

  // In the frame of the surface that was scored last.
  void scoreOrthomosaic(const std::filesystem::path& file) {
    if (surface_ && existsOrNote(file))
      addColours("orthomosaic", colouredPoints(file, *surface_, alignment_));
  }

  // A mesh in the frame of the program that was scored last.
  void scoreFile(const std::filesystem::path& file) {
    const Mesh mesh = readPly(file);
    if (sampleSurface(mesh, 1).empty())
      throw InputError(file.string(), "", "has no surface to compare; give a mesh with triangles");
    prepareSurface();
    report_.surfaces.emplace_back(file.string(), scoreSurface(mesh, *surface_, seen_, start_));
  }

 private:
  void addColours(const std::string& name, const std::vector<ColouredPoint>& points) {
    if (const auto score = scoreColours(points, *surface_, alignment_, rig_.left, cameras_))
      report_.colours.emplace_back(name, *score);
  }

  bool existsOrNote(const std::filesystem::path& file) {
    if (std::filesystem::exists(file)) return true;
    note(file, "is absent: not scored");
    return false;
  }
  void note(const std::filesystem::path& file, const char* what) {
    report_.notes.push_back(file.lexically_relative(paths_.root).string() + " " + what);
  }

  // Folder of the true mission.toml and stereo.calib: those in the mission's root may have calibration
  // errors. Other missions have only these.
  [[nodiscard]] std::filesystem::path trueFolder() const {
    return std::filesystem::exists(io::MissionPaths(paths_.truth()).calib()) ? paths_.truth() : paths_.root;
  }

  // Reads the true surface, which is large, when the first estimate needs it.
  void prepareSurface() {
    if (surface_) return;
    const auto file = paths_.truth() / "terrain.ply";
    Mesh mesh = readPly(file);
    if (mesh.empty()) throw InputError(file.string(), "", "has no triangles; make the mission again");
    surface_ = std::make_unique<TruthSurface>(std::move(mesh));
    rig_ = readStereoCalib(io::MissionPaths(trueFolder()).calib());
    std::vector<SE3> poses;
    for (const std::int64_t utc_ns : truth_.exposures()) {
      if (const auto pose = truth_.poseAt(utc_ns)) poses.push_back(*pose * config_.T_body_cam);
    }
    if (poses.empty()) note(paths_.truth() / "images.csv", "lists no exposures: coverage is 0");
    seen_ = visibleSeafloor(*surface_, rig_.left, poses);
    cameras_ = std::move(poses);
  }

  io::MissionPaths paths_;
  io::MissionConfig config_;
  TruthTrack truth_;
  ScoreReport& report_;
  std::unique_ptr<TruthSurface> surface_;
  VisibleSeafloor seen_;
  StereoRig rig_;
  std::vector<SE3> cameras_;  // true poses
  SE3 start_;                 // of the alignment, from the last trajectory
  SE3 alignment_;             // of the last surface
};

nlohmann::ordered_json orNull(const std::optional<double>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json(nullptr);
}

nlohmann::ordered_json toJson(const std::optional<TrajectoryScore>& score, bool rms_only) {
  if (!score) return nullptr;
  nlohmann::ordered_json json;
  json["rms_m"] = score->rms_m;
  if (rms_only) return json;
  json["aligned_rms_m"] = orNull(score->aligned_rms_m);
  json["crossover_rms_m"] = orNull(score->crossover_rms_m);
  json["tilt_rms_rad"] = orNull(score->tilt_rms_rad);
  json["heading_rms_rad"] = orNull(score->heading_rms_rad);
  json["nees"] = orNull(score->nees);
  json["share_below_95_percent"] = orNull(score->inside);
  return json;
}

// A small motion: shift of the origin, and rotation vector.
nlohmann::ordered_json toJson(const SE3& motion) {
  const Eigen::AngleAxisd turn(motion.rotation());
  const Eigen::Vector3d angles = (turn.angle() * turn.axis()).unaryExpr(&radiansToDegrees);
  return {{"north_m", motion.translation().x()}, {"east_m", motion.translation().y()},
          {"down_m", motion.translation().z()},  {"about_north_deg", angles.x()},
          {"about_east_deg", angles.y()},        {"about_down_deg", angles.z()}};
}

nlohmann::ordered_json toJson(const std::optional<SurfaceScore>& score) {
  if (!score) return nullptr;
  nlohmann::ordered_json json;
  json["rms_m"] = score->rms_m;
  json["aligned_rms_m"] = score->aligned_rms_m;
  json["p50_m"] = score->p50_m;
  json["p95_m"] = score->p95_m;
  json["p99_m"] = score->p99_m;
  json["bias_m"] = score->bias_m;
  json["squared_over_variance"] = orNull(score->squared_over_variance);
  json["aligned_bias_m"] = score->aligned_bias_m;
  json["aligned_p95_m"] = score->aligned_p95_m;
  json["alignment"] = toJson(score->alignment);
  json["coverage"] = score->coverage;
  json["completeness"] = score->completeness;
  return json;
}

std::string decimalsOrDash(const std::optional<double>& value, int digits, double unit = 1) {
  return value ? decimals(*value / unit, digits) : "-";
}

void trajectoryRow(std::string& out, const char* name, const std::optional<TrajectoryScore>& s) {
  const auto cell = [&](int width, const std::string& text) {
    out +=
        std::string(static_cast<std::size_t>(width) - std::min<std::size_t>(text.size(), width), ' ') + text;
  };
  out += formatted("  %-16s", name);
  cell(8, s ? decimalsOrDash(s->rms_m, 4) : "-");
  cell(10, s ? decimalsOrDash(s->aligned_rms_m, 4) : "-");
  cell(11, s ? decimalsOrDash(s->crossover_rms_m, 4) : "-");
  cell(8, s ? decimalsOrDash(s->tilt_rms_rad, 2, kRadiansPerDegree) : "-");
  cell(9, s ? decimalsOrDash(s->heading_rms_rad, 2, kRadiansPerDegree) : "-");
  cell(7, s ? decimalsOrDash(s->nees, 1) : "-");
  cell(8, s && s->inside ? decimals(100 * *s->inside, 1) + "%" : "-");
  cell(8, s ? std::to_string(s->poses) : "-");
  out += "\n";
}

void surfaceRow(std::string& out, const char* name, const std::optional<SurfaceScore>& s) {
  const auto over_sigma = [&] {
    return s->squared_over_variance ? decimals(std::sqrt(*s->squared_over_variance), 2) : std::string("-");
  };
  out += s ? formatted("  %-10s %9.4f %12.4f %9.4f %9.4f %9.4f %9.4f %9.1f%% %11s\n", name, s->rms_m,
                       s->aligned_rms_m, s->p50_m, s->p95_m, s->p99_m, s->bias_m, 100.0 * s->coverage,
                       over_sigma().c_str())
           : formatted("  %-10s %9s %12s %9s %9s %9s %9s %10s %11s\n", name, "-", "-", "-", "-", "-", "-",
                       "-", "-");
}

}  // namespace

ScoreReport scoreMission(const std::filesystem::path& mission,
                         const std::vector<std::filesystem::path>& surfaces) {
  ScoreReport report;
  Scorer scorer(mission, report);
  const io::MissionPaths paths(mission);
  scorer.scoreDeadReckoning();
  scorer.scoreProgram(paths.onboard(), "map.ply", report.onboard, report.onboard_surface);
  scorer.scoreProgram(paths.topside(), "mesh.ply", report.topside, report.topside_surface);
  if (report.topside_surface) scorer.scoreOrthomosaic(paths.topside() / "layers" / "orthomosaic.tif");
  for (const std::filesystem::path& file : surfaces) scorer.scoreFile(file);
  return report;
}

std::string scoreJson(const ScoreReport& report) {
  nlohmann::ordered_json json;
  json["trajectory"]["dead_reckoning"] = toJson(report.dead_reckoning, true);
  json["trajectory"]["onboard"] = toJson(report.onboard, false);
  json["trajectory"]["topside"] = toJson(report.topside, false);
  json["surface"]["onboard"] = toJson(report.onboard_surface);
  json["surface"]["topside"] = toJson(report.topside_surface);
  for (const auto& [name, score] : report.surfaces) json["surface"]["files"][name] = toJson(score);
  for (const auto& [name, s] : report.colours)
    json["colour"][name] = {{"median", s.median},         {"p95", s.p95},
                            {"chroma", s.chroma},         {"with_depth", s.with_depth},
                            {"with_range", s.with_range}, {"gains", {s.gains.x(), s.gains.y(), s.gains.z()}},
                            {"squares", s.squares.size()}};
  return json.dump();
}

std::string scoreTable(const ScoreReport& report) {
  std::string out =
      "trajectory [m]          rms   aligned  crossover  tilt [deg] heading   NEES  in 95 %   poses\n";
  trajectoryRow(out, "dead reckoning", report.dead_reckoning);
  trajectoryRow(out, "onboard", report.onboard);
  trajectoryRow(out, "topside", report.topside);
  out +=
      "surface [m]        rms      aligned       p50       p95       p99      bias   coverage  over sigma\n";
  surfaceRow(out, "onboard", report.onboard_surface);
  surfaceRow(out, "topside", report.topside_surface);
  for (const auto& [name, score] : report.surfaces) surfaceRow(out, name.c_str(), score);
  if (!report.colours.empty())
    out += "colour [CIEDE2000]  median       p95   chroma  correlated with depth, range   squares\n";
  for (const auto& [name, s] : report.colours)
    out += formatted("  %-14s %9.2f %9.2f %8.2f %14.2f %14.2f %9zu\n", name.c_str(), s.median, s.p95,
                     s.chroma, s.with_depth, s.with_range, s.squares.size());
  if (!report.colours.empty())
    out +=
        "by quantity: bounds of thirds, median and 95 % of each, correlation of lightness; by colour: "
        "median, "
        "95 %, squares\n";
  for (const auto& [name, s] : report.colours) out += "  " + name + "\n" + colourDetail(s);
  return out;
}

}  // namespace fathom::sim
