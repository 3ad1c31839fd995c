#include <array>
#include <cstdio>
#include <memory>
#include <string_view>

#include "realtime/base/files/output_folder.hpp"
#include "recon/closure/candidates.hpp"
#include "recon/topside/commands/commands.hpp"
#include "recon/topside/config/thread_limit.hpp"
#include "recon/topside/dive.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/slam_report.hpp"
#include "recon/topside/work/repair.hpp"

namespace fathom::topside {
namespace {

constexpr std::array<std::string_view, 6> kSlamFiles = {"stereo_pose_est.data",
                                                        "vehicle_pose_est.data",
                                                        "closures.csv",
                                                        "pose_covariances.csv",
                                                        "slam.html",
                                                        "slam.json"};

void localiseInto(const RunPlaces& places, const TopsideConfig& config) {
  // Bad input leaves no folders behind.
  MissionInput input = openMission(places.mission, places.input);
  sayAssumed(input);
  if (input.given_poses)
    throw InputError(places.mission.string(), "stereo_pose_est.data",
                     "gives the poses: there is nothing to localise");
  OutputFolder out(places.out.empty() ? places.mission / "slam" : places.out, kSlamFiles);
  StageStore store(places.work.empty() ? places.mission / "topside.work" : places.work,
                   StageStore::Access::kAlone);
  RunProgress progress(expectedShareUpTo(Stage::kLocalise));
  Dive dive(std::move(input), config, store, progress, Permission());
  const SlamResult& slam = *dive.localised();
  if (slam.frames == 0)
    for (const PairFacts& pair : dive.prepared().facts())
      if (!pair.unreadable.empty())
        throw InputError(places.mission.string(), "img",
                         "no pair gives features; the first that cannot be read: " + pair.unreadable);
  const PairList& list = dive.survey().list;
  const io::MissionConfig& mission = dive.input().mission;
  const StereoRig& rig = dive.input().rig;

  const SeedPlanes planes = dive.planes();
  std::vector<FusedPair> posed;
  for (std::size_t k = 0; k < list.pairs.size(); ++k) {
    const auto& pose = slam.poses[k].T_nav_body;
    if (!pose) continue;
    const SE3 T_nav_cam = *pose * mission.T_body_cam;
    const double range = planes[k]->ahead();
    posed.push_back({list.pairs[k], *pose, T_nav_cam, slam.poses[k].altitude.value_or(0), range,
                     closure::footprintOf(T_nav_cam, range, rig.left).radius, 0, false});
  }
  if (posed.empty()) throw InputError(places.mission.string(), "img", "no pair has a pose");
  writePoses(out.path(), mission.origin, posed);
  writeClosures(out.path() / "closures.csv", list.pairs, slam.closures);
  writePoseCovariances(out.path(), list.pairs, slam);
  const Consistency truth = compareWithTruth(places.mission, mission.T_body_cam, rig.left, list, slam);
  writeSlamReport(out.path(), slam, dive.survey().navigation, mission.T_body_cam, list.features_only, truth);
  out.commit();
  std::size_t kept = 0;
  for (const slam::NavigationLink& link : slam.closures) kept += link.kept ? 1 : 0;
  std::printf(
      "%zu poses, %zu odometry links, %zu closures of %zu tried (%zu taken out again); moved %.3f m rms\n",
      posed.size(), slam.odometry.size(), kept, slam.tried.size(), slam.closures.size() - kept,
      slam.moved_rms);
  if (const auto sentence = controlSentence(slam.control)) std::printf("%s\n", sentence->c_str());
  for (const std::string& warning : slamWarnings(slam)) std::fprintf(stderr, "%s\n", warning.c_str());
}

int runSlam(RunSettings& settings) {
  TopsideConfig config = configOf(settings);
  config.slam = true;
  const ThreadLimit limit(config);
  withRepair([&] { localiseInto(settings.places, config); });
  return kExitSuccess;
}

}  // namespace

void addSlamCommand(CommandLine& app) {
  const auto settings = std::make_shared<RunSettings>();
  CommandLine& command =
      app.command("slam", "visual odometry and loop closures of a mission: poses, without a map",
                  "Example: fathom-topside slam missions/reef-grid --out poses",
                  [settings] { return runSlam(*settings); });
  command.add_option("mission", settings->places.mission, "mission folder")->required();
  command.add_option("--out", settings->places.out, "folder for the results (MISSION/slam)");
  addPoseSettings(command, *settings);
  for (const char* other : {"--no-slam", "--poses"}) command.remove_option(command.get_option(other));
}

}  // namespace fathom::topside
