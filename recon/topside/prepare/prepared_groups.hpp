#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/feature_stage.hpp"
#include "recon/topside/prepare/pair_preparer.hpp"
#include "recon/topside/work/stage_runner.hpp"
#include "recon/topside/work/stage_store.hpp"

namespace fathom::topside {

// What became of a pair before its place was known.
struct PairFacts {
  bool placed = false;     // navigation knows where it was taken
  std::string unreadable;  // the error's line
  std::uint64_t points = 0;
  std::uint32_t corners = 0, features = 0;
  stereo::StereoResult::Rejected rejected;
  bool has_mesh = false, unlit = false;

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.placed, self.unreadable, self.points, self.corners, self.features, self.rejected,
            self.has_mesh, self.unlit);
  }
};

// Consecutive pairs that are prepared, and kept, together: enough that a file is worth opening, few enough
// that little is lost with it.
constexpr std::size_t kPairsInGroup = 32;
[[nodiscard]] constexpr std::size_t groupsOf(std::size_t pairs) {
  return (pairs + kPairsInGroup - 1) / kPairsInGroup;
}

// Blocks of a group's work file: the facts of all its pairs, and features and mesh of each that has them.
void writePrepared(WorkFileWriter& file, std::size_t first_pair, const std::vector<PreparedPair>& pairs,
                   const std::vector<bool>& placed);

// The prepared pairs of a mission, read from the groups' files as they are asked for.
class PreparedGroups final : public FeatureStore {
 public:
  explicit PreparedGroups(std::vector<WorkFile> groups);
  // From here on all that `from` triangulated is read as `to` would have.
  void setRig(const StereoRig& from, const StereoRig& to) { rigs_.emplace(from, to); }
  // The pair has no place in the model.
  void leaveOut(std::size_t pair) { facts_[pair].has_mesh = false; }
  [[nodiscard]] std::size_t count(std::size_t pair) const override { return facts_[pair].features; }
  void load(std::size_t pair, closure::FrameFeatures& out) const override;
  [[nodiscard]] const std::vector<PairFacts>& facts() const { return facts_; }
  [[nodiscard]] Mesh mesh(std::size_t pair) const;  // in the left camera frame; throws DamagedWork
  [[nodiscard]] const Digest& meshDigest(std::size_t pair) const;
  [[nodiscard]] Digest content() const;

 private:
  [[nodiscard]] const WorkFile& groupOf(std::size_t pair) const { return groups_[pair / kPairsInGroup]; }
  std::vector<WorkFile> groups_;
  std::vector<PairFacts> facts_;
  std::optional<std::pair<StereoRig, StereoRig>> rigs_;  // from, to
};

// What pairs are prepared from. All that it points to must outlive the stage.
struct PrepareInputs {
  const MissionInput* input = nullptr;
  const TopsideConfig* config = nullptr;
  const Survey* survey = nullptr;
  const LightingModels* lighting = nullptr;
  Digest lighting_content;
  const std::vector<Digest>* image_identities = nullptr;  // of every pair
  bool localised = true;                                  // features are wanted, not meshes alone
};

// Pairs read once, group by group (PreparedGroups). The pairs of a group are made in parallel; the results do
// not depend on the number of threads.
class PrepareStage {
 public:
  explicit PrepareStage(const PrepareInputs& inputs) : in_(inputs) {}
  // One a group; the stage must outlive them.
  [[nodiscard]] std::vector<StageTask> tasks();

 private:
  [[nodiscard]] Digest key(std::size_t first, std::size_t last) const;
  Costs make(std::size_t first, std::size_t last, WorkFileWriter& file);

  PrepareInputs in_;
  oneapi::tbb::enumerable_thread_specific<std::unique_ptr<PairPreparer>> preparers_;
};

}  // namespace fathom::topside
