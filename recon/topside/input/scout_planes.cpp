#include "recon/topside/input/scout_planes.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <memory>
#include <opencv2/core.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/lighting/demosaic.hpp"
#include "recon/stereo/seed_plane.hpp"

namespace fathom::topside {
namespace {}  // namespace

stereo::SeedPlane seedPlane(const io::MissionConfig& mission, const SE3& T_nav_body, double altitude) {
  // Of the attitude alone, bit by bit: a pose that moved leaves what was made of its images as it was.
  const Eigen::Matrix3d R_nav_body = T_nav_body.matrix3();
  stereo::SeedPlane plane;
  plane.normal = (R_nav_body * mission.T_body_cam.matrix3()).transpose() * Eigen::Vector3d::UnitZ();
  plane.distance =
      altitude + (R_nav_body * (mission.T_body_dvl.translation() - mission.T_body_cam.translation())).z();
  return plane;
}

SeedPlanes seedPlanes(const io::MissionConfig& mission, const std::vector<NavigatedPose>& poses,
                      double default_altitude) {
  SeedPlanes planes;
  double altitude = default_altitude;
  for (const NavigatedPose& pose : poses) {
    if (pose.altitude) altitude = *pose.altitude;
    planes.emplace_back();
    if (!pose.T_nav_body) continue;
    planes.back() = seedPlane(mission, *pose.T_nav_body, altitude);
    if (planes.back()->normal.z() < kLooksAhead)
      planes.back() = stereo::SeedPlane{Eigen::Vector3d::UnitZ(), default_altitude};
  }
  return planes;
}

std::vector<std::uint8_t> stretchedGrey(const ImageView& image) {
  const std::size_t channels = image.format == PixelFormat::kRgb ? 3 : 1;
  const cv::Mat in(image.height, image.width * static_cast<int>(channels), image.bits == 8 ? CV_8U : CV_16U,
                   const_cast<void*>(image.data), image.stride);
  constexpr double kMean = 85;
  cv::Mat eight_bit;
  in.convertTo(eight_bit, CV_8U, kMean / std::max(cv::mean(in)[0], 1.0));
  std::vector<std::uint8_t> grey(static_cast<std::size_t>(image.width) *
                                 static_cast<std::size_t>(image.height));
  cv::Mat rgb(image.height, image.width, CV_8UC3);
  lighting::greyOf({eight_bit.data, image.width, image.height, eight_bit.step[0], image.format, 8},
                   lighting::usualShares(image.format), rgb.data, grey.data());
  if (image.mask != nullptr) fillHidden(grey.data(), 1, *image.mask);
  return grey;
}

SeedPlanes scoutPlanes(const MissionInput& input, const TopsideConfig& config, const PairList& list) {
  const std::size_t count = list.pairs.size();
  SeedPlanes found(count);
  oneapi::tbb::enumerable_thread_specific<std::unique_ptr<stereo::PlaneScout>> scouts;
  rt::StageProgress progress("scouting", count);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    std::unique_ptr<stereo::PlaneScout>& scout = scouts.local();
    if (!scout) scout = std::make_unique<stereo::PlaneScout>(input.rig, config.stereo);
    try {
      const io::ImageFile left = input.image(list.pairs[k], 0), right = input.image(list.pairs[k], 1);
      const auto left_grey = stretchedGrey(left.view), right_grey = stretchedGrey(right.view);
      found[k] = scout->find(eightBitView(left_grey, input.rig.left, PixelFormat::kMono, left.view.mask),
                             eightBitView(right_grey, input.rig.right, PixelFormat::kMono, right.view.mask));
    } catch (const InputError&) {  // counted where it is used
    }
    progress.step();
  });
  SeedPlanes planes = found;
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t away = 1; !planes[k] && away < count; ++away) {
      if (k >= away && found[k - away]) planes[k] = found[k - away];
      if (!planes[k] && k + away < count && found[k + away]) planes[k] = found[k + away];
    }
  // One that cannot be read is named where pairs are prepared, which needs a plane of some kind.
  for (auto& plane : planes)
    if (!plane) plane.emplace();
  return planes;
}

}  // namespace fathom::topside
