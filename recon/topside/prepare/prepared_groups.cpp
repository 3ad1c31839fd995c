#include "recon/topside/prepare/prepared_groups.hpp"

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
                     static_cast<std::uint32_t>(pair.features.size()), pair.rejected, !pair.mesh.empty()});
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
  if (scale_ == 1) return;
  const auto scale = static_cast<float>(scale_);
  for (closure::Feature& feature : out.features) {
    feature.point *= scale;
    for (float& of : feature.covariance) of *= scale * scale;
  }
}

Mesh PreparedGroups::mesh(std::size_t pair) const {
  const WorkFile& group = groupOf(pair);
  Mesh mesh;
  if (!loadMesh(group.read(meshName(pair)), mesh)) throw DamagedWork(group.path());
  if (scale_ == 1) return mesh;
  const auto scale = static_cast<float>(scale_);
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex *= scale;
  for (float& sigma : mesh.sigma) sigma *= scale;
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

}  // namespace fathom::topside
