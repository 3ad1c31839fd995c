#include "recon/topside/prepare/prepared_groups.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <algorithm>
#include <array>
#include <cstdio>

#include "recon/calibration/rig_history.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/topside/work/mesh_bytes.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {
namespace {

std::string meshName(std::size_t pair) {
  return "mesh " + std::to_string(pair);
}
std::string featuresName(std::size_t pair) {
  return "features " + std::to_string(pair);
}

}  // namespace

void writePrepared(WorkFileWriter& file, std::size_t first_pair, const std::vector<PreparedPair>& pairs,
                   const std::vector<bool>& placed) {
  std::vector<PairFacts> facts;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const PreparedPair& pair = pairs[k];
    facts.push_back({placed[k], pair.unreadable, pair.points, pair.corners,
                     static_cast<std::uint32_t>(pair.features.size()), pair.rejected, !pair.mesh.empty(),
                     pair.unlit});
    if (!pair.mesh.empty()) file.add(meshName(first_pair + k), meshBytes(pair.mesh));
    if (pair.features.size() == 0) continue;
    Bytes slot(closure::slotBytes(pair.features.size()));
    if (!closure::writeSlot(pair.features, slot)) throw std::logic_error("features do not fit their slot");
    file.add(featuresName(first_pair + k), slot);
  }
  saveBlock(file, "facts", facts);
}

PreparedGroups::PreparedGroups(std::vector<WorkFile> groups) : groups_(std::move(groups)) {
  for (const WorkFile& group : groups_) {
    const auto facts = loadBlock<std::vector<PairFacts>>(group, "facts");
    facts_.insert(facts_.end(), facts.begin(), facts.end());
  }
}

void PreparedGroups::load(std::size_t pair, closure::FrameFeatures& out) const {
  const WorkFile& group = groupOf(pair);
  if (!closure::readSlot(group.read(featuresName(pair)), out)) throw DamagedWork(group.path());
  if (rigs_) retriangulate(rigs_->first, rigs_->second, out);
}

Mesh PreparedGroups::mesh(std::size_t pair) const {
  const WorkFile& group = groupOf(pair);
  Mesh mesh;
  if (!loadMesh(group.read(meshName(pair)), mesh)) throw DamagedWork(group.path());
  if (rigs_) calibration::retriangulate(rigs_->first, rigs_->second, mesh);
  return mesh;
}

const Digest& PreparedGroups::meshDigest(std::size_t pair) const {
  return groupOf(pair).digestOf(meshName(pair));
}

Digest PreparedGroups::content() const {
  Hasher hasher;
  for (const WorkFile& group : groups_) hasher.add(group.content());
  return hasher.finish();
}

namespace {

// Changes whenever the same inputs and settings give another result.
constexpr std::uint32_t kPrepareVersion = 18;

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
