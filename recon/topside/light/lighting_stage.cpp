#include "recon/topside/light/lighting_stage.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_pipeline.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/stereo/point_filter.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/light/pair_images.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {
namespace {

constexpr std::uint32_t kLightingVersion = 18;  // changes with the result
constexpr int kRangePoints = 300;               // corners that show an image's ranges well enough

// Of one moment, by camera.
struct Images {
  ImagePair pair;
  std::vector<std::optional<io::ImageFile>> files;
  std::vector<lighting::RangeLattice> ranges;  // unknown without a pose
};

std::optional<io::ImageFile> readOrPass(const MissionInput& input, const ImagePair& pair,
                                        std::size_t camera) {
  try {
    return input.image(pair, camera);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

// Ranges of a pair's images: the seed plane, bent to what stereo finds.
class RangeFinder {
 public:
  RangeFinder(const MissionInput& input, const stereo::SparseStereoConfig& config)
      : rig_(input.rig), stereo_(input.rig, config) {
    for (std::size_t camera = 0; camera < input.cameras(); ++camera)
      ranges_.emplace_back(input.camera(camera), input.T_cam_left(camera));
  }

  void find(const stereo::SeedPlane& plane, Images& images) {
    std::vector<Eigen::Vector3f> points;
    if (const auto& left = images.files[0], &right = images.files[1]; left && right) {
      const std::vector<std::uint8_t> left_grey = stretchedGrey(left->view),
                                      right_grey = stretchedGrey(right->view);
      stereo::StereoResult found =
          stereo_.process(eightBitView(left_grey, rig_.left, PixelFormat::kMono, left->view.mask),
                          eightBitView(right_grey, rig_.right, PixelFormat::kMono, right->view.mask), plane);
      stereo::smoothPoints(found);
      for (const stereo::StereoPoint& p : found.points) points.push_back(p.point);
    }
    for (std::size_t camera = 0; camera < ranges_.size(); ++camera)
      images.ranges[camera] = ranges_[camera].of(plane, points);
  }

 private:
  const StereoRig& rig_;
  std::vector<CameraRanges> ranges_;
  stereo::SparseStereo stereo_;
};

}  // namespace

LightingModels::LightingModels(const MissionInput& input, const lighting::LightingConfig& config)
    : left(input.rig.left.width, input.rig.left.height, input.format(0), input.bits(0), config),
      right(input.rig.right.width, input.rig.right.height, input.format(1), input.bits(1), config) {
  for (const ColourCamera& c : input.colour_cameras)
    colour.push_back(
        std::make_unique<lighting::LightingModel>(c.camera.width, c.camera.height, c.format, c.bits, config));
}

std::vector<std::size_t> lightingPairs(std::size_t pairs, const TopsideConfig& config) {
  const std::size_t count = std::min(pairs, static_cast<std::size_t>(config.lighting_images));
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < count; ++k) chosen.push_back(k * pairs / count);
  return chosen;
}

Digest lightingKey(const MissionInput& input, const TopsideConfig& config, const Digest& survey,
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
  if (!input.colour_cameras.empty()) addRig(hasher, input);
  for (const std::size_t pair : lightingPairs(image_identities.size(), config))
    hasher.add(image_identities[pair]);
  return hasher.finish();
}

void saveLighting(WorkFileWriter& file, const LightingModels& models) {
  file.add("models", savedBytes([&](rt::StateWriter& writer) {
             models.left.save(writer);
             models.right.save(writer);
             for (const auto& model : models.colour) model->save(writer);
             writer(models.unreadable);
           }));
}

void loadLighting(const WorkFile& file, LightingModels& models) {
  const Bytes bytes = file.read("models");
  rt::StateReader reader(bytes);
  bool whole = models.left.load(reader) && models.right.load(reader);
  for (const auto& model : models.colour) whole = whole && model->load(reader);
  if (!whole || !reader(models.unreadable)) throw DamagedWork(file.path());
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
                images->pair = pairs[index];
                images->ranges.resize(input.cameras());
                for (std::size_t camera = 0; camera < input.cameras(); ++camera)
                  images->files.push_back(readOrPass(input, pairs[index], camera));
                if (const auto& plane = survey.planes[index]) {
                  std::unique_ptr<RangeFinder>& finder = finders.local();
                  if (!finder) finder = std::make_unique<RangeFinder>(input, stereo);
                  finder->find(*plane, *images);
                }
                return images;
              }) &
          tbb::make_filter<std::shared_ptr<Images>, void>(
              tbb::filter_mode::serial_in_order, [&](const std::shared_ptr<Images>& images) {
                for (std::size_t camera = 0; camera < images->files.size(); ++camera) {
                  const auto& file = images->files[camera];
                  if (file)
                    models.of(camera).add(file->view, images->ranges[camera],
                                          images->pair.exposureOf(camera));
                  if (!file && camera < 2) ++models.unreadable;
                }
                progress.step();
              }));
}

}  // namespace fathom::topside
