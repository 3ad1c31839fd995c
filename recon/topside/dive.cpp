#include "recon/topside/dive.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/input/seed_plane.hpp"
#include "recon/topside/work/stage_archive.hpp"
#include "recon/topside/work/stage_keys.hpp"

namespace fathom::topside {
namespace {

// Change whenever the same inputs and settings give another result.
constexpr std::uint32_t kSurveyVersion = 2, kLightingVersion = 1, kPrepareVersion = 1, kLocaliseVersion = 4,
                        kPlanVersion = 1;
// Expected shares of a run's time, of a dive with images.
constexpr std::array<double, kStages> kWeights = {0.01, 0.04, 0.40, 0.10, 0.01, 0.40, 0.04};
template <typename T>
void load(const WorkFile& file, const std::string& block, T& value) {
  const Bytes bytes = file.read(block);
  rt::StateReader reader(bytes);
  if (!reader(value) || reader.left() != 0) throw DamagedWork(file.path());
}

template <typename T>
void save(WorkFileWriter& file, const std::string& block, const T& value) {
  file.add(block, savedBytes([&](rt::StateWriter& writer) { writer(value); }));
}

std::string sixDigits(std::size_t number) {
  std::array<char, 24> text{};
  std::snprintf(text.data(), text.size(), "%06zu", number);
  return text.data();
}

void add(stereo::StereoResult::Rejected& sum, const stereo::StereoResult::Rejected& one) {
  sum.no_track += one.no_track;
  sum.left_right += one.left_right;
  sum.epipolar += one.epipolar;
  sum.range += one.range;
  sum.outlier += one.outlier;
  sum.fish += one.fish;
}

}  // namespace

double weightOf(Stage stage) {
  return kWeights[static_cast<std::size_t>(stage)];
}
const char* nameOf(Stage stage) {
  return kStageNames[static_cast<std::size_t>(stage)];
}

double expectedShare(const std::optional<Stage>& only) {
  return only ? weightOf(*only) : 1.0;
}

std::optional<Stage> stageNamed(const std::string& name) {
  for (std::size_t k = 0; k < kStages; ++k)
    if (name == kStageNames[k]) return static_cast<Stage>(k);
  return std::nullopt;
}

Dive::Dive(MissionInput input, const TopsideConfig& config, StageStore& store, RunProgress& progress,
           Permission permission)
    : input_(std::move(input)),
      config_(config),
      store_(store),
      progress_(progress),
      permission_(permission),
      grid_(tileGridOf(config.fusion.voxel)) {
  // Coarse voxels reach further than the usual overlap.
  constexpr double kReaches = 2.5;
  double& overlap = config_.model.division.overlap;
  overlap = std::max(overlap, kReaches * fusion::VolumetricFusion(config.fusion).reach());
}

Dive::~Dive() = default;

void Dive::missing(Stage stage) const {
  throw InputError(store_.folder().string(), nameOf(stage),
                   std::string("not made yet, or of other inputs or settings; run 'fathom-topside stage ") +
                       nameOf(stage) + "' with the same settings first");
}

WorkFile Dive::single(Stage stage, const Digest& key, const std::function<void(WorkFileWriter&)>& make) {
  const std::string name = nameOf(stage);
  if (auto found = store_.find(name, "all", key)) {
    if (permission_.allows(stage)) {
      progress_.begin(name, 1, weightOf(stage));
      progress_.step(true);
      progress_.end();
    }
    outcomes_.emplace_back(name, StageOutcome{1, 0, 0});
    return std::move(*found);
  }
  if (!permission_.allows(stage)) missing(stage);
  outcomes_.emplace_back(name, runStage(store_, name,
                                        {{"all", key,
                                          [&](WorkFileWriter& file) {
                                            make(file);
                                            return Costs();
                                          }}},
                                        1, progress_, weightOf(stage)));
  return store_.get(name, "all", key);
}

void Dive::run(Stage stage, const std::string& name, std::vector<StageTask> tasks, double weight) {
  if (!permission_.allows(stage)) {
    for (const StageTask& task : tasks)
      if (!store_.open(name, task.item, task.key)) missing(stage);
    return;
  }
  // Tiles of a piece are made in parallel from the same images: few pieces at once keep these in memory.
  constexpr std::size_t kThreadsOfPiece = 4;
  const std::size_t threads = threadsAllowed();
  const std::size_t at_once =
      stage == Stage::kPiece ? (threads + kThreadsOfPiece - 1) / kThreadsOfPiece : threads;
  if (permission_.items) {
    const auto [first, last] = *permission_.items;
    if (first >= tasks.size())
      throw InputError("--piece", std::to_string(first),
                       "there are " + std::to_string(tasks.size()) + ", counted from 0");
    tasks = {tasks.begin() + static_cast<std::ptrdiff_t>(first),
             tasks.begin() + static_cast<std::ptrdiff_t>(std::min(last, tasks.size()))};
  }
  outcomes_.emplace_back(name, runStage(store_, name, tasks, at_once, progress_, weight));
}

const Survey& Dive::survey() {
  if (survey_) return *survey_;
  Hasher hasher;
  hasher.add("survey", kSurveyVersion, input_.identity);
  addRig(hasher, input_);
  addNavigationSettings(hasher, config_);
  const WorkFile file = single(Stage::kSurvey, hasher.finish(), [&](WorkFileWriter& out) {
    save(out, "survey", takeSurvey(input_, config_));
  });
  load(file, "survey", survey_.emplace());
  survey_content_ = file.content();
  for (const ImagePair& pair : survey_->list.pairs)
    image_identities_.push_back(input_.imageIdentity(pair.left, pair.right));
  return *survey_;
}

const LightingModels& Dive::lighting() {
  if (lighting_) return *lighting_;
  const Survey& dive = survey();
  auto models = std::make_unique<LightingModels>(input_.mission, input_.rig, config_.lighting);
  if (input_.features_only) {
    lighting_ = std::move(models);
    return *lighting_;
  }
  Hasher hasher;
  hasher.add("lighting", kLightingVersion, survey_content_);
  addLightingSettings(hasher, config_);
  addStereoSettings(hasher, config_);
  for (const std::size_t pair : lightingPairs(dive.list.pairs.size(), config_))
    hasher.add(image_identities_[pair]);
  const WorkFile file = single(Stage::kLighting, hasher.finish(), [&](WorkFileWriter& out) {
    LightingModels learnt(input_.mission, input_.rig, config_.lighting);
    learnLighting(input_.paths, input_.mission, input_.rig, dive.list.pairs, dive.navigation.poses, config_,
                  learnt);
    out.add("models", savedBytes([&](rt::StateWriter& writer) {
              learnt.left.save(writer);
              learnt.right.save(writer);
              writer(learnt.unreadable);
            }));
  });
  const Bytes bytes = file.read("models");
  rt::StateReader reader(bytes);
  if (!models->left.load(reader) || !models->right.load(reader) || !reader(models->unreadable))
    throw DamagedWork(file.path());
  lighting_content_ = file.content();
  lighting_ = std::move(models);
  return *lighting_;
}

StageTask Dive::prepareTask(std::size_t group, const std::vector<double>& altitudes) {
  const std::vector<ImagePair>& pairs = survey_->list.pairs;
  const std::vector<NavigatedPose>& poses = survey_->navigation.poses;
  const std::size_t first = group * kPairsInGroup, last = std::min(pairs.size(), first + kPairsInGroup);
  const bool slam = config_.slam && !input_.given_poses;
  Hasher hasher;
  hasher.add("prepare", kPrepareVersion, lighting_content_, slam, config_.slam_features);
  addRig(hasher, input_);
  addStereoSettings(hasher, config_);
  for (std::size_t k = first; k < last; ++k) {
    const auto& pose = poses[k].T_nav_body;
    hasher.add(pairs[k].left, pairs[k].right, image_identities_[k], altitudes[k], pose.has_value());
    // The attitude alone places the seed plane.
    if (pose) addPose(hasher, SE3(pose->rotation(), Eigen::Vector3d::Zero()));
  }
  return {sixDigits(group), hasher.finish(),
          [this, &pairs, &poses, &altitudes, first, last, slam](WorkFileWriter& file) {
            std::vector<PreparedPair> made(last - first);
            std::vector<bool> placed;
            for (std::size_t k = first; k < last; ++k) placed.push_back(poses[k].T_nav_body.has_value());
            oneapi::tbb::parallel_for(first, last, [&](std::size_t k) {
              std::unique_ptr<PairPreparer>& preparer = preparers_.local();
              if (!preparer)
                preparer = makePreparer(input_.paths, input_.mission, input_.rig, config_, *lighting_,
                                        input_.features_only, Wanted{slam, true});
              if (const auto& pose = poses[k].T_nav_body)
                made[k - first] = preparer->process(pairs[k], *pose, altitudes[k]);
            });
            PairTimes times;
            for (const PreparedPair& pair : made) times += pair.times;
            writePrepared(file, first, made, placed);
            Costs costs;
            for (std::size_t s = 0; s < kPairStages; ++s) costs[kPairStageNames[s]] = times.seconds[s];
            return costs;
          }};
}

void Dive::makePrepared() {
  if (!prepared_files_.empty()) return;
  (void)lighting();
  const std::vector<double> altitudes = seedAltitudes(survey_->navigation.poses, config_.default_altitude);
  std::vector<StageTask> tasks;
  for (std::size_t group = 0; group < groupsOf(survey_->list.pairs.size()); ++group)
    tasks.push_back(prepareTask(group, altitudes));
  run(Stage::kPrepare, nameOf(Stage::kPrepare), tasks, weightOf(Stage::kPrepare));
  preparers_.clear();
  if (permission_.only == Stage::kPrepare) return;
  for (const StageTask& task : tasks)
    prepared_files_.push_back(store_.get(nameOf(Stage::kPrepare), task.item, task.key));
}

const PreparedGroups& Dive::prepared() {
  if (prepared_) return *prepared_;
  makePrepared();
  prepared_ = std::make_unique<PreparedGroups>(prepared_files_);
  return *prepared_;
}

const SlamResult* Dive::localised() {
  if (localised_) return slam_ ? &*slam_ : nullptr;
  const PreparedGroups& groups = prepared();
  Hasher poses;
  poses.add(survey_content_);
  if (config_.slam && !input_.given_poses) {
    Hasher hasher;
    hasher.add("localise", kLocaliseVersion, survey_content_, groups.content());
    addRig(hasher, input_);
    addNavigationSettings(hasher, config_);
    addSlamSettings(hasher, config_);
    const WorkFile file = single(Stage::kLocalise, hasher.finish(), [&](WorkFileWriter& out) {
      save(out, "slam", localise(input_.mission, input_.rig, config_, survey_->navigation, groups));
    });
    load(file, "slam", slam_.emplace());
    poses.add(file.content());
  }
  poses_content_ = poses.finish();
  localised_ = true;
  T_nav_cam_ = cameraPoses(this->poses(), input_.mission.T_body_cam);
  return slam_ ? &*slam_ : nullptr;
}

const std::vector<NavigatedPose>& Dive::poses() {
  (void)localised();
  return slam_ ? slam_->poses : survey_->navigation.poses;
}

const ModelPlan& Dive::plan() {
  if (plan_) return *plan_;
  (void)localised();
  Hasher hasher;
  const fusion::DivisionConfig& division = config_.model.division;
  hasher.add("plan", kPlanVersion, poses_content_, prepared_->content(), grid_.voxel, grid_.leaf_voxels,
             config_.model.texel, division.target_meshes, division.max_meshes, division.overlap);
  addRig(hasher, input_);
  const WorkFile file = single(Stage::kPlan, hasher.finish(), [&](WorkFileWriter& out) {
    static const std::vector<slam::NavigationLink> kNone;
    ModelPlan plan = planModel(*prepared_, T_nav_cam_, slam_ ? slam_->closures : kNone, grid_, division);
    plan.texel = config_.model.texel > 0 ? config_.model.texel
                                         : nativeTexel(input_, survey_->navigation, config_.default_altitude);
    out.add("plan", planBytes(plan));
  });
  if (!loadPlan(file.read("plan"), plan_.emplace())) throw DamagedWork(file.path());
  // Texels larger than pixels are made from images reduced as much.
  const double pixel = nativeTexel(input_, survey_->navigation, config_.default_altitude);
  config_.model.blend.bands.reduction = std::max(1, static_cast<int>(plan_->texel / pixel));
  return *plan_;
}

void Dive::make(Stage stage) {
  switch (stage) {
    case Stage::kSurvey:
      (void)survey();
      break;
    case Stage::kLighting:
      (void)lighting();
      break;
    case Stage::kPrepare:
      makePrepared();
      break;
    case Stage::kLocalise:
      (void)localised();
      break;
    case Stage::kPlan:
      (void)plan();
      break;
    case Stage::kPiece:
      makePieces();
      break;
    case Stage::kLevel:
      (void)levels();
      break;
  }
}

std::size_t Dive::items(Stage stage) {
  if (stage == Stage::kPrepare) return groupsOf(survey().list.pairs.size());
  if (stage == Stage::kPiece) return plan().pieces.size();
  return 1;
}

FuseResult Dive::fused() {
  constexpr std::size_t kErrorLines = 10;  // unreadable images named in the report
  FuseResult out;
  const std::vector<NavigatedPose>& known = poses();
  for (std::size_t k = 0; k < known.size(); ++k) {
    const PairFacts& facts = prepared_->facts()[k];
    FuseCounts& counts = out.counts;
    if (!facts.placed || !known[k].T_nav_body) {
      ++counts.without_pose;
      continue;
    }
    if (!facts.unreadable.empty()) {
      ++counts.unreadable;
      if (counts.unreadable_lines.size() < kErrorLines) counts.unreadable_lines.push_back(facts.unreadable);
      continue;
    }
    ++(facts.has_mesh ? counts.used : counts.too_few_points);
    counts.points += facts.points;
    counts.corners += facts.corners;
    add(counts.rejected, facts.rejected);
    FusedPair pair;
    pair.pair = survey_->list.pairs[k];
    pair.T_nav_body = *known[k].T_nav_body;
    pair.T_nav_cam = T_nav_cam_[k];
    pair.altitude = known[k].altitude.value_or(0);
    pair.points = facts.points;
    pair.used = facts.has_mesh;
    if (pair.used) {
      const auto& box = plan().footprints[k].box;
      pair.footprint_radius = 0.5 * std::hypot(box[2] - box[0], box[3] - box[1]);
    }
    out.pairs.push_back(std::move(pair));
  }
  return out;
}

}  // namespace fathom::topside
