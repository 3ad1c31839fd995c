#pragma once

#include <cstddef>
#include <vector>

#include "recon/closure/frame_features.hpp"

namespace fathom::topside {

// What the pairs of a mission are recognised by, kept where the caller wants: in memory or in files. load()
// may be called by several threads at once.
class FeatureStore {
 public:
  virtual ~FeatureStore() = default;
  [[nodiscard]] virtual std::size_t count(std::size_t pair) const = 0;  // 0: cannot be read, or shows nothing
  // Replaces `out`; its memory is used again. Throws InputError for a file that cannot be read any more.
  virtual void load(std::size_t pair, closure::FrameFeatures& out) const = 0;
};

// All in memory: 74 kB a pair of 400 features.
class MemoryFeatureStore final : public FeatureStore {
 public:
  explicit MemoryFeatureStore(std::vector<closure::FrameFeatures> features)
      : features_(std::move(features)) {}
  [[nodiscard]] std::size_t count(std::size_t pair) const override { return features_[pair].size(); }
  void load(std::size_t pair, closure::FrameFeatures& out) const override { out = features_[pair]; }

 private:
  std::vector<closure::FrameFeatures> features_;
};

}  // namespace fathom::topside
