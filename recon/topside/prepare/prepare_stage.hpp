#pragma once

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <memory>
#include <vector>

#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"
#include "recon/topside/work/stage_runner.hpp"

namespace fathom::topside {

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
