#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/topside/levels/level_stage.hpp"
#include "recon/topside/pieces/fused_pair.hpp"
#include "recon/topside/pieces/piece_stage.hpp"
#include "recon/topside/plan/plan_stage.hpp"
#include "recon/topside/prepare/prepared_groups.hpp"
#include "recon/topside/prepare/rig_finding.hpp"
#include "recon/topside/work/stage_runner.hpp"

namespace fathom::topside {

// The stages of a dive in their order. Each is made from those before; "survey" and what follows it to
// "plan" know the whole dive, "prepare", "piece" and "level" are made of items.
enum class Stage : std::uint8_t { kSurvey, kLighting, kPrepare, kLocalise, kPlan, kPiece, kLevel };
constexpr std::size_t kStages = 7;
inline constexpr std::array<const char*, kStages> kStageNames = {"survey", "lighting", "prepare", "localise",
                                                                 "plan",   "piece",    "level"};
[[nodiscard]] std::optional<Stage> stageNamed(const std::string& name);
[[nodiscard]] const char* nameOf(Stage stage);
// Of a whole run's time, of a dive with images.
[[nodiscard]] double weightOf(Stage stage);
[[nodiscard]] double expectedShare(const std::optional<Stage>& only);
[[nodiscard]] double expectedShareUpTo(Stage last);

// Whether poses come from the images too.
[[nodiscard]] inline bool localises(const MissionInput& input, const TopsideConfig& config) {
  return (config.slam || !input.navigated) && !input.given_poses;
}

// What a process may make; what else it needs must be in the store.
struct Permission {
  std::optional<Stage> only;                                 // none: all stages
  std::optional<std::pair<std::size_t, std::size_t>> items;  // of that stage: first, one past the last
  [[nodiscard]] bool allows(Stage stage) const { return !only || *only == stage; }
};

// A dive while it becomes a model: every stage's result is taken from the store, or made and put there.
class Dive {
 public:
  Dive(MissionInput input, const TopsideConfig& config, StageStore& store, RunProgress& progress,
       Permission permission);
  ~Dive();

  // Stage by stage, in order; each call makes what is not there. Throws InputError when a stage that must not
  // be made is not there.
  const Survey& survey();
  const LightingModels& lighting();
  void makePrepared();
  const PreparedGroups& prepared();
  const SlamResult* localised();              // null: dead reckoning, or poses that were given
  const std::vector<NavigatedPose>& poses();  // after localisation
  [[nodiscard]] SeedPlanes planes();          // the same, where navigation places them
  const ModelPlan& plan();
  void makePieces();
  // Pieces and levels, finest first.
  const std::vector<TilePlaces>& levels();
  void make(Stage stage);

  // Its rig is, from lighting on, as this dive shows it, and from localisation on as control points do.
  [[nodiscard]] const MissionInput& input() const { return input_; }
  [[nodiscard]] const RigFinding& rigFinding() const { return rig_finding_; }  // after lighting
  [[nodiscard]] const TopsideConfig& config() const { return config_; }
  [[nodiscard]] const TileGrid& grid() const { return grid_; }
  [[nodiscard]] LayerCells layerCells();
  [[nodiscard]] const std::vector<WorkFile>& pieceFiles() const { return piece_files_; }
  [[nodiscard]] std::size_t items(Stage stage);  // of prepare, piece
  [[nodiscard]] FuseResult fused();
  // Forgets results of pieces and parents that this dive's plan does not have any more.
  void dropOldItems();
  // Of this process, in order.
  [[nodiscard]] const std::vector<std::pair<std::string, StageOutcome>>& outcomes() const {
    return outcomes_;
  }

 private:
  // The result of a stage that is one item.
  WorkFile single(Stage stage, const Digest& key, const std::function<Costs(WorkFileWriter&)>& make);
  void run(Stage stage, const std::string& name, std::vector<StageTask> tasks, double weight);
  std::vector<StageTask> pieceTasks();
  void applyRig(const calibration::RangeError& error, double scale);
  [[nodiscard]] double pixelOf(std::size_t camera) const;  // on the ground [m]
  [[nodiscard]] bool textured() const { return config_.model.texture && !input_.features_only; }
  [[noreturn]] void missing(Stage stage) const;

  MissionInput input_;
  TopsideConfig config_;
  StageStore& store_;
  RunProgress& progress_;
  Permission permission_;
  TileGrid grid_;

  std::optional<Survey> survey_;
  Digest survey_content_, lighting_content_, poses_content_;
  std::vector<Digest> image_identities_;
  std::unique_ptr<LightingModels> lighting_;
  RigFinding rig_finding_;
  std::vector<WorkFile> prepared_files_;
  std::unique_ptr<PreparedGroups> prepared_;
  std::optional<SlamResult> slam_;
  bool localised_ = false;
  std::vector<SE3> T_nav_cam_;
  std::optional<ModelPlan> plan_;
  std::vector<TextureCamera> texture_cameras_;
  std::unique_ptr<ViewImages> images_;
  PieceInputs piece_inputs_;
  std::vector<WorkFile> piece_files_;
  std::vector<TilePlaces> levels_;
  std::vector<std::pair<std::string, StageOutcome>> outcomes_;
};

}  // namespace fathom::topside
