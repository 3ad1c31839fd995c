#include "recon/topside/pieces/view_images.hpp"

namespace fathom::topside {

ViewImages::ViewImages(const MissionInput& input, const Survey& survey, const LightingModels& lighting,
                       const PreparedGroups& prepared, const GroundLight& light,
                       const std::vector<TextureCamera>& cameras, std::size_t most_bytes)
    : input_(input),
      survey_(survey),
      lighting_(lighting),
      prepared_(prepared),
      light_(light),
      cameras_(cameras),
      most_bytes_(most_bytes) {}

ViewImages::Image ViewImages::get(std::uint32_t view) {
  std::promise<Image> promise;
  {
    std::unique_lock lock(mutex_);
    const auto known = entries_.find(view);
    if (known != entries_.end()) {
      uses_.splice(uses_.begin(), uses_, known->second.use);
      const std::shared_future<Image> image = known->second.image;
      lock.unlock();
      return image.get();
    }
    uses_.push_front(view);
    entries_[view] = {promise.get_future().share(), uses_.begin(), 0};
  }
  Image image;
  try {
    image = read(view);
  } catch (...) {
    promise.set_exception(std::current_exception());
    throw;
  }
  promise.set_value(image);
  const std::lock_guard lock(mutex_);
  const auto entry = entries_.find(view);
  if (entry != entries_.end()) {
    entry->second.bytes = image ? image->bytes() : 0;
    bytes_ += entry->second.bytes;
  }
  forgetOld();
  return image;
}

void ViewImages::forgetOld() {
  while (bytes_ > most_bytes_ && uses_.size() > 1) {
    const auto entry = entries_.find(uses_.back());
    bytes_ -= entry->second.bytes;
    entries_.erase(entry);
    uses_.pop_back();
  }
}

ViewImages::Image ViewImages::read(std::uint32_t view) {
  const auto cameras = static_cast<std::uint32_t>(cameras_.size());
  const std::uint32_t pair = view / cameras;
  const TextureCamera& camera = cameras_[view % cameras];
  const auto& plane = survey_.planes[pair];
  if (!plane) return nullptr;
  std::unique_ptr<PairImages> reader;
  {
    const std::lock_guard lock(mutex_);
    if (!idle_.empty()) {
      reader = std::move(idle_.back());
      idle_.pop_back();
    }
  }
  if (!reader) reader = std::make_unique<PairImages>(input_, lighting_);
  Image image;
  if (reader->readCamera(survey_.list.pairs[pair], camera.number)) {
    Mesh mesh;
    if (prepared_.facts()[pair].has_mesh) mesh = prepared_.mesh(pair);
    RgbImage colours =
        reader->colours(*plane, mesh.vertices, light_.gains[pair], light_.water, camera.number);
    image = std::make_shared<const surface::BandImage>(
        surface::makeBands(std::move(colours), camera.bands, reader->mask(camera.number)));
  }
  const std::lock_guard lock(mutex_);
  idle_.push_back(std::move(reader));
  return image;
}

}  // namespace fathom::topside
