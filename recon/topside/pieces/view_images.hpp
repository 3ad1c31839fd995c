#pragma once

#include <cstdint>
#include <future>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/surface/band_image.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/light/lighting_stage.hpp"
#include "recon/topside/light/pair_images.hpp"
#include "recon/topside/plan/ground_light.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"

namespace fathom::topside {

// A camera whose images are texture.
struct TextureCamera {
  std::size_t number = 0;  // of MissionInput
  Camera camera;           // as its images are in `bands`
  SE3 T_left_cam;
  surface::BandWidths bands;
};

// One camera's image of a pair, as the texture numbers them.
[[nodiscard]] inline std::uint32_t viewOf(std::uint32_t pair, std::uint32_t camera, std::size_t cameras) {
  return pair * static_cast<std::uint32_t>(cameras) + camera;
}

// Images in colour, corrected for light by the ranges that stereo found, and divided into bands: what
// texture is made of. Those used last are kept, up to a number of bytes. Thread-safe: an image that several
// threads ask for is read once.
class ViewImages {
 public:
  ViewImages(const MissionInput& input, const Survey& survey, const LightingModels& lighting,
             const PreparedGroups& prepared, const GroundLight& light,
             const std::vector<TextureCamera>& cameras, std::size_t most_bytes);
  ViewImages(const ViewImages&) = delete;
  ViewImages& operator=(const ViewImages&) = delete;

  using Image = std::shared_ptr<const surface::BandImage>;
  [[nodiscard]] Image get(std::uint32_t view);  // null where it cannot be read

 private:
  struct Entry {
    std::shared_future<Image> image;
    std::list<std::uint32_t>::iterator use;
    std::size_t bytes = 0;
  };
  [[nodiscard]] Image read(std::uint32_t view);
  void forgetOld();

  const MissionInput& input_;
  const Survey& survey_;
  const LightingModels& lighting_;
  const PreparedGroups& prepared_;
  const GroundLight& light_;
  const std::vector<TextureCamera>& cameras_;
  std::size_t most_bytes_, bytes_ = 0;
  mutable std::mutex mutex_;
  std::unordered_map<std::uint32_t, Entry> entries_;
  std::list<std::uint32_t> uses_;                  // the last one first
  std::vector<std::unique_ptr<PairImages>> idle_;  // readers
};

}  // namespace fathom::topside
