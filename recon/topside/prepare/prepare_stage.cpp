#include "recon/topside/prepare/prepare_stage.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstdio>

namespace fathom::topside {
namespace {

// Changes whenever the same inputs and settings give another result.
constexpr std::uint32_t kPrepareVersion = 6;

std::string sixDigits(std::size_t number) {
  std::array<char, 24> text{};
  std::snprintf(text.data(), text.size(), "%06zu", number);
  return text.data();
}

}  // namespace

std::vector<StageTask> PrepareStage::tasks() {
  std::vector<StageTask> tasks;
  const std::size_t pairs = in_.survey->list.pairs.size();
  for (std::size_t group = 0; group < groupsOf(pairs); ++group) {
    const std::size_t first = group * kPairsInGroup, last = std::min(pairs, first + kPairsInGroup);
    tasks.push_back({sixDigits(group), key(first, last),
                     [this, first, last](WorkFileWriter& file) { return make(first, last, file); }});
  }
  return tasks;
}

Digest PrepareStage::key(std::size_t first, std::size_t last) const {
  Hasher hasher;
  hasher.add("prepare", kPrepareVersion, in_.lighting_content, in_.localised, in_.config->slam_features);
  addRig(hasher, *in_.input);
  addStereoSettings(hasher, *in_.config);
  for (std::size_t k = first; k < last; ++k) {
    const ImagePair& pair = in_.survey->list.pairs[k];
    hasher.add(pair.left, pair.right, (*in_.image_identities)[k]);
    addPlane(hasher, in_.survey->planes[k]);
  }
  return hasher.finish();
}

Costs PrepareStage::make(std::size_t first, std::size_t last, WorkFileWriter& file) {
  const SeedPlanes& planes = in_.survey->planes;
  std::vector<PreparedPair> made(last - first);
  std::vector<bool> placed;
  for (std::size_t k = first; k < last; ++k) placed.push_back(planes[k].has_value());
  oneapi::tbb::parallel_for(first, last, [&](std::size_t k) {
    std::unique_ptr<PairPreparer>& preparer = preparers_.local();
    if (!preparer) preparer = makePreparer(*in_.input, *in_.config, *in_.lighting, in_.localised);
    if (planes[k]) made[k - first] = preparer->process(in_.survey->list.pairs[k], *planes[k]);
  });
  PairTimes times;
  for (const PreparedPair& pair : made) times += pair.times;
  writePrepared(file, first, made, placed);
  Costs costs;
  for (std::size_t s = 0; s < kPairStages; ++s) costs[kPairStageNames[s]] = times.seconds[s];
  return costs;
}

}  // namespace fathom::topside
