#include "recon/topside/stages/fuse_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_pipeline.h>

#include <memory>

#include "recon/topside/stages/seed_plane.hpp"

namespace fathom::topside {
namespace {

constexpr std::size_t kErrorLines = 10;  // unreadable images named in the report

struct Job {
  std::size_t index = 0;
  bool has_pose = false;
  double altitude = 0;  // seed of stereo [m]
  PairResult result;
};

void add(stereo::StereoResult::Rejected& sum, const stereo::StereoResult::Rejected& one) {
  sum.no_track += one.no_track;
  sum.left_right += one.left_right;
  sum.epipolar += one.epipolar;
  sum.range += one.range;
  sum.outlier += one.outlier;
  sum.fish += one.fish;
}

}  // namespace

FuseResult fusePairs(const std::vector<ImagePair>& pairs, const std::vector<NavigatedPose>& poses,
                     const std::function<std::unique_ptr<PairMesher>()>& make_stage, double default_altitude,
                     fusion::VolumetricFusion& fusion, Progress& progress) {
  namespace tbb = oneapi::tbb;
  FuseResult out;
  tbb::enumerable_thread_specific<std::unique_ptr<PairMesher>> stages;

  const auto match = [&](const std::shared_ptr<Job>& job) {
    if (!job->has_pose) return job;
    std::unique_ptr<PairMesher>& stage = stages.local();
    if (!stage) stage = make_stage();
    job->result = stage->process(pairs[job->index], *poses[job->index].T_nav_body, job->altitude);
    return job;
  };
  const auto fuse = [&](const std::shared_ptr<Job>& job) {
    FuseCounts& counts = out.counts;
    PairResult& result = job->result;
    progress.step();
    if (!job->has_pose) {
      ++counts.without_pose;
      return;
    }
    if (!result.unreadable.empty()) {
      ++counts.unreadable;
      if (counts.unreadable_lines.size() < kErrorLines) counts.unreadable_lines.push_back(result.unreadable);
      return;
    }
    Stopwatch watch;
    const bool used = !result.mesh.empty();
    if (used) fusion.integrate(result.mesh, result.T_nav_cam.translation());
    result.times[PairStage::kFusion] = watch.lap();
    ++(used ? counts.used : counts.too_few_points);
    counts.points += result.points;
    counts.corners += result.corners;
    add(counts.rejected, result.rejected);
    counts.times += result.times;
    const NavigatedPose& pose = poses[job->index];
    out.pairs.push_back({pairs[job->index], *pose.T_nav_body, result.T_nav_cam, pose.altitude.value_or(0),
                         result.footprint_radius, result.points, used});
  };

  std::size_t next = 0;
  const std::vector<double> altitudes = seedAltitudes(poses, default_altitude);
  tbb::parallel_pipeline(
      static_cast<std::size_t>(2 * tbb::info::default_concurrency()),
      tbb::make_filter<void, std::shared_ptr<Job>>(tbb::filter_mode::serial_in_order,
                                                   [&](tbb::flow_control& flow) -> std::shared_ptr<Job> {
                                                     if (next == pairs.size()) {
                                                       flow.stop();
                                                       return nullptr;
                                                     }
                                                     const NavigatedPose& pose = poses[next];
                                                     auto job = std::make_shared<Job>();
                                                     job->has_pose = pose.T_nav_body.has_value();
                                                     job->altitude = altitudes[next];
                                                     job->index = next++;
                                                     return job;
                                                   }) &
          tbb::make_filter<std::shared_ptr<Job>, std::shared_ptr<Job>>(tbb::filter_mode::parallel, match) &
          tbb::make_filter<std::shared_ptr<Job>, void>(tbb::filter_mode::serial_in_order, fuse));
  return out;
}

}  // namespace fathom::topside
