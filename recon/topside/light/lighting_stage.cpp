#include "recon/topside/light/lighting_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_pipeline.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/progress.hpp"
#include "recon/geometry/eight_bit_view.hpp"
#include "recon/lighting/rig_ranges.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint32_t kLightingVersion = 8;  // changes with the result
constexpr int kRangePoints = 300;              // corners that show an image's ranges well enough

struct Images {
  std::optional<io::ImageFile> left, right;
  lighting::RangeLattice left_range, right_range;  // unknown without a pose
};

std::optional<io::ImageFile> readOrPass(const MissionInput& input, const std::string& name, CameraSide side) {
  try {
    return input.image(name, side);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

// Ranges of a pair's images: the seed plane, bent to what stereo finds.
class RangeFinder {
 public:
  RangeFinder(const StereoRig& rig, const stereo::SparseStereoConfig& config)
      : rig_(rig), ranges_(rig), stereo_(rig, config) {}

  void find(const stereo::SeedPlane& plane, Images& images) {
    ranges_.fromPlane(plane.normal, plane.distance);
    if (images.left && images.right) {
      const std::vector<std::uint8_t> left = stretchedGrey(images.left->view);
      const std::vector<std::uint8_t> right = stretchedGrey(images.right->view);
      std::vector<Eigen::Vector3f> points;
      for (const stereo::StereoPoint& p :
           stereo_
               .process(eightBitView(left, rig_.left, PixelFormat::kMono, images.left->view.mask),
                        eightBitView(right, rig_.right, PixelFormat::kMono, images.right->view.mask), plane)
               .points)
        points.push_back(p.point);
      std::vector<Eigen::Vector3f> right_points(points.size());
      ranges_.bendTo(points, right_points);
    }
    images.left_range = ranges_.left();
    images.right_range = ranges_.right();
  }

 private:
  const StereoRig& rig_;
  lighting::RigRanges ranges_;
  stereo::SparseStereo stereo_;
};

}  // namespace

LightingModels::LightingModels(const io::MissionConfig& mission, const StereoRig& rig,
                               const lighting::LightingConfig& config)
    : left(rig.left.width, rig.left.height, mission.cameras.left_format, mission.cameras.bits, config),
      right(rig.right.width, rig.right.height, mission.cameras.right_format, mission.cameras.bits, config) {}

std::vector<std::size_t> lightingPairs(std::size_t pairs, const TopsideConfig& config) {
  const std::size_t count = std::min(pairs, static_cast<std::size_t>(config.lighting_images));
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < count; ++k) chosen.push_back(k * pairs / count);
  return chosen;
}

Digest lightingKey(const TopsideConfig& config, const Digest& survey,
                   const std::vector<Digest>& image_identities) {
  const lighting::LightingConfig& c = config.lighting;
  static_assert(sizeof c == 48);  // a new setting belongs here too
  Hasher hasher;
  hasher.add("lighting", kLightingVersion, survey, config.lighting_images, c.target_mean, c.target_sigma,
             c.min_images, c.grid, c.saturated, c.outlier, c.choice);
  addStereoSettings(hasher, config);
  // The rig is found with it.
  const slam::SensorNoise& n = config.navigation.noise;
  hasher.add(config.slam_features, n.dvl_velocity, n.dvl_rate, n.dvl_scale, n.dvl_heading, n.heading);
  for (const std::size_t pair : lightingPairs(image_identities.size(), config))
    hasher.add(image_identities[pair]);
  return hasher.finish();
}

void saveLighting(WorkFileWriter& file, const LightingModels& models) {
  file.add("models", savedBytes([&](rt::StateWriter& writer) {
             models.left.save(writer);
             models.right.save(writer);
             writer(models.unreadable);
           }));
}

void loadLighting(const WorkFile& file, LightingModels& models) {
  const Bytes bytes = file.read("models");
  rt::StateReader reader(bytes);
  if (!models.left.load(reader) || !models.right.load(reader) || !reader(models.unreadable))
    throw DamagedWork(file.path());
}

void learnLighting(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                   LightingModels& models) {
  const std::vector<ImagePair>& pairs = survey.list.pairs;
  const std::vector<std::size_t> chosen = lightingPairs(pairs.size(), config);
  const std::size_t count = chosen.size();
  rt::StageProgress progress("lighting", count);
  std::size_t next = 0;
  namespace tbb = oneapi::tbb;
  stereo::SparseStereoConfig stereo = config.stereo;
  stereo.max_features = std::min(stereo.max_features, kRangePoints);
  tbb::enumerable_thread_specific<std::unique_ptr<RangeFinder>> finders;
  tbb::parallel_pipeline(
      static_cast<std::size_t>(2 * tbb::info::default_concurrency()),
      tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order,
                                          [&](tbb::flow_control& flow) -> std::size_t {
                                            if (next == count) {
                                              flow.stop();
                                              return 0;
                                            }
                                            return chosen[next++];
                                          }) &
          tbb::make_filter<std::size_t, std::shared_ptr<Images>>(
              tbb::filter_mode::parallel,
              [&](std::size_t index) {
                auto images = std::make_shared<Images>();
                images->left = readOrPass(input, pairs[index].left, CameraSide::kLeft);
                images->right = readOrPass(input, pairs[index].right, CameraSide::kRight);
                if (const auto& plane = survey.planes[index]) {
                  std::unique_ptr<RangeFinder>& finder = finders.local();
                  if (!finder) finder = std::make_unique<RangeFinder>(input.rig, stereo);
                  finder->find(*plane, *images);
                }
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
