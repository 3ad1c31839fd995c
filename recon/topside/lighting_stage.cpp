#include "recon/topside/lighting_stage.hpp"

#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_pipeline.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "firmware_if/image_file.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/topside/seed_plane.hpp"

namespace fathom::topside {
namespace {

struct Images {
  std::optional<io::ImageFile> left, right;
  lighting::RangeLattice left_range, right_range;  // unknown without a pose
};

std::optional<io::ImageFile> readOrPass(const std::filesystem::path& path, PixelFormat format, int bits,
                                        const Camera& camera) {
  try {
    return io::readImage(path, format, bits, camera.width, camera.height);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace

LightingModels::LightingModels(const io::MissionConfig& mission, const StereoRig& rig,
                               const lighting::LightingConfig& config)
    : left(rig.left.width, rig.left.height, mission.cameras.left_format, mission.cameras.bits, config),
      right(rig.right.width, rig.right.height, mission.cameras.right_format, mission.cameras.bits, config) {}

void learnLighting(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig,
                   const std::vector<ImagePair>& pairs, const std::vector<NavigatedPose>& poses,
                   double default_altitude, std::size_t count, LightingModels& models, Progress& progress) {
  const auto& cameras = mission.cameras;
  const std::vector<double> altitudes = seedAltitudes(poses, default_altitude);
  std::size_t next = 0;
  namespace tbb = oneapi::tbb;
  tbb::parallel_pipeline(
      static_cast<std::size_t>(2 * tbb::info::default_concurrency()),
      tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order,
                                          [&](tbb::flow_control& flow) -> std::size_t {
                                            if (next == count) {
                                              flow.stop();
                                              return 0;
                                            }
                                            return next++ * pairs.size() / count;
                                          }) &
          tbb::make_filter<std::size_t, std::shared_ptr<Images>>(
              tbb::filter_mode::parallel,
              [&](std::size_t index) {
                auto images = std::make_shared<Images>();
                if (const auto& T_nav_body = poses[index].T_nav_body) {
                  const stereo::SeedPlane plane = seedPlane(mission, *T_nav_body, altitudes[index]);
                  lighting::RigRanges ranges(rig);
                  ranges.fromPlane(plane.normal, plane.distance);
                  images->left_range = ranges.left();
                  images->right_range = ranges.right();
                }
                images->left = readOrPass(paths.images() / pairs[index].left, cameras.left_format,
                                          cameras.bits, rig.left);
                images->right = readOrPass(paths.images() / pairs[index].right, cameras.right_format,
                                           cameras.bits, rig.right);
                return images;
              }) &
          tbb::make_filter<std::shared_ptr<Images>, void>(
              tbb::filter_mode::serial_in_order, [&](const std::shared_ptr<Images>& images) {
                if (images->left) models.left.add(images->left->view, images->left_range);
                if (images->right) models.right.add(images->right->view, images->right_range);
                models.unreadable += (images->left ? 0U : 1U) + (images->right ? 0U : 1U);
                progress.step();
              }));
}

}  // namespace fathom::topside
