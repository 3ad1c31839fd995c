#include "recon/topside/pieces/view_images.hpp"

namespace fathom::topside {

ViewImages::ViewImages(const MissionInput& input, const Survey& survey, const LightingModels& lighting,
                       const PreparedGroups& prepared, const std::vector<float>& gains,
                       const surface::BandWidths& bands, std::size_t most_bytes)
    : input_(input),
      survey_(survey),
      lighting_(lighting),
      prepared_(prepared),
      gains_(gains),
      bands_(bands),
      most_bytes_(most_bytes) {}

ViewImages::Image ViewImages::get(std::uint32_t pair) {
  std::promise<Image> promise;
  {
    std::unique_lock lock(mutex_);
    const auto known = entries_.find(pair);
    if (known != entries_.end()) {
      uses_.splice(uses_.begin(), uses_, known->second.use);
      const std::shared_future<Image> image = known->second.image;
      lock.unlock();
      return image.get();
    }
    uses_.push_front(pair);
    entries_[pair] = {promise.get_future().share(), uses_.begin(), 0};
  }
  Image image;
  try {
    image = read(pair);
  } catch (...) {
    promise.set_exception(std::current_exception());
    throw;
  }
  promise.set_value(image);
  const std::lock_guard lock(mutex_);
  const auto entry = entries_.find(pair);
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

ViewImages::Image ViewImages::read(std::uint32_t pair) {
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
  if (reader->readLeft(survey_.list.pairs[pair])) {
    Mesh mesh;
    if (prepared_.facts()[pair].has_mesh) mesh = prepared_.mesh(pair);
    RgbImage colours = reader->colours(*plane, mesh.vertices, gains_[pair]);
    image = std::make_shared<const surface::BandImage>(
        surface::makeBands(std::move(colours), bands_, reader->mask()));
  }
  const std::lock_guard lock(mutex_);
  idle_.push_back(std::move(reader));
  return image;
}

}  // namespace fathom::topside
