#include "recon/topside/dive.hpp"

#include <oneapi/tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "recon/topside/light/pair_images.hpp"
#include "recon/topside/localise/free_network.hpp"
#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::topside {
namespace {

// Expected share of a run's time of each stage, for a dive with images.
constexpr std::array<double, kStages> kWeights = {0.01, 0.04, 0.40, 0.10, 0.01, 0.40, 0.04};

// Vertical altitude of the vehicle over the plane that its camera sees [m]; 0 if the plane is as steep as a
// wall.
double altitudeOver(const stereo::SeedPlane& plane, const SE3& T_nav_cam, const SE3& T_nav_body) {
  constexpr double kLeastVertical = 0.2;  // component of the plane's normal
  const double vertical = plane.normal.dot(T_nav_cam.rotation().conjugate() * Eigen::Vector3d::UnitZ());
  const double camera_below_body = T_nav_cam.translation().z() - T_nav_body.translation().z();
  return vertical > kLeastVertical ? plane.distance / vertical + camera_below_body : 0;
}

void add(stereo::StereoResult::Rejected& sum, const stereo::StereoResult::Rejected& one) {
  sum.no_track += one.no_track;
  sum.left_right += one.left_right;
  sum.epipolar += one.epipolar;
  sum.range += one.range;
  sum.outlier += one.outlier;
  sum.fish += one.fish;
}

// Numbers of the cameras with colours; if none has, of the left camera.
std::vector<std::size_t> camerasOfTexture(const MissionInput& input) {
  std::vector<std::size_t> out;
  for (std::size_t number = 0; number < input.cameras(); ++number)
    if (input.format(number) != PixelFormat::kMono) out.push_back(number);
  if (out.empty()) out.push_back(0);
  return out;
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

double expectedShareUpTo(Stage last) {
  double sum = 0;
  for (std::size_t k = 0; k <= static_cast<std::size_t>(last); ++k) sum += kWeights[k];
  return sum;
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

WorkFile Dive::single(Stage stage, const Digest& key, const std::function<Costs(WorkFileWriter&)>& make) {
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
  outcomes_.emplace_back(name, runStage(store_, name, {{"all", key, make}}, 1, progress_, weightOf(stage)));
  return store_.get(name, "all", key);
}

void Dive::run(Stage stage, const std::string& name, std::vector<StageTask> tasks, double weight) {
  if (!permission_.allows(stage)) {
    for (const StageTask& task : tasks)
      if (!store_.open(name, task.item, task.key)) missing(stage);
    return;
  }
  // A piece's tiles are made in parallel from the same images, which stay in memory: few pieces at once.
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
  const WorkFile file = single(Stage::kSurvey, surveyKey(input_, config_), [&](WorkFileWriter& out) {
    saveBlock(out, "survey", takeSurvey(input_, config_));
    return Costs();
  });
  survey_ = loadBlock<Survey>(file, "survey");
  survey_content_ = file.content();
  if (input_.control) {
    // Checked here already, before the long stages.
    if (!localises(input_, config_))
      throw InputError(input_.control->folder.string(), "",
                       "holds control points, which are of no use with --no-slam: leave one of them out");
    (void)sightingsOf(*input_.control, survey_->list);
  }
  if (input_.masks) input_.masks->requireUse(survey_->list);
  for (const ImagePair& pair : survey_->list.pairs) image_identities_.push_back(input_.imageIdentity(pair));
  return *survey_;
}

const LightingModels& Dive::lighting() {
  if (lighting_) return *lighting_;
  const Survey& dive = survey();
  auto models = std::make_unique<LightingModels>(input_, config_.lighting);
  const auto find = [&](const LightingModels& by) {
    return config_.mend_rig ? findRig(input_, config_, dive, by) : RigFinding();
  };
  if (input_.features_only) {
    rig_finding_ = find(*models);
  } else {
    const Digest key = lightingKey(input_, config_, survey_content_, image_identities_);
    const WorkFile file = single(Stage::kLighting, key, [&](WorkFileWriter& out) {
      auto learnt = std::make_unique<LightingModels>(input_, config_.lighting);
      learnLighting(input_, config_, dive, *learnt);
      const RigFinding found = find(*learnt);
      if (found.moved) {
        // The light was learnt with ranges of the uncorrected rig.
        MissionInput corrected = input_;
        corrected.rig = rigAsFound(input_.rig, found);
        learnt = std::make_unique<LightingModels>(corrected, config_.lighting);
        learnLighting(corrected, config_, dive, *learnt);
      }
      saveLighting(out, *learnt);
      saveBlock(out, "rig", found);
      return Costs();
    });
    loadLighting(file, *models);
    lighting_content_ = file.content();
    rig_finding_ = loadBlock<RigFinding>(file, "rig");
  }
  input_.rig = rigAsFound(input_.rig, rig_finding_);
  config_.navigation.rig = rigPrior(input_.rig, rig_finding_);
  lighting_ = std::move(models);
  return *lighting_;
}

void Dive::makePrepared() {
  if (!prepared_files_.empty()) return;
  PrepareStage stage({&input_, &config_, &survey(), &lighting(), lighting_content_, &image_identities_,
                      localises(input_, config_)});
  const std::vector<StageTask> tasks = stage.tasks();
  run(Stage::kPrepare, nameOf(Stage::kPrepare), tasks, weightOf(Stage::kPrepare));
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
  if (localises(input_, config_)) {
    const Digest key = localiseKey(input_, config_, survey_content_, groups.content());
    const WorkFile file = single(Stage::kLocalise, key, [&](WorkFileWriter& out) {
      oneapi::tbb::enumerable_thread_specific<std::unique_ptr<PairImages>> readers;
      GreyImages images;
      if (!input_.features_only)
        images = [&](std::uint32_t pair) {
          std::unique_ptr<PairImages>& reader = readers.local();
          if (!reader) reader = std::make_unique<PairImages>(input_, *lighting_);
          const auto& plane = survey_->planes[pair];
          return plane && reader->readLeft(survey_->list.pairs[pair]) ? reader->correctLeft(*plane)
                                                                      : ImageView();
        };
      const SlamResult slam = input_.navigated ? localise(input_, config_, *survey_, groups, images)
                                               : localiseFreely(input_, config_, *survey_, groups, images);
      saveSlam(out, slam);
      return slam.seconds;
    });
    slam_ = loadSlam(file);
    slam_->seconds = store_.costs(nameOf(Stage::kLocalise))["all"];
    poses.add(file.content());
    applyRig(slam_->scale.error(), slam_->control.scale);
  }
  poses_content_ = poses.finish();
  localised_ = true;
  T_nav_cam_ = cameraPoses(this->poses(), input_.mission.T_body_cam);
  for (std::size_t k = 0; k < T_nav_cam_.size(); ++k)
    if (!this->poses()[k].T_nav_body) prepared_->leaveOut(k);
  return slam_ ? &*slam_ : nullptr;
}

// Applies what the DVL's paths and control points say of the rig to all that images have measured.
void Dive::applyRig(const calibration::RangeError& error, double scale) {
  if (error.per_metre == 0 && scale == 1) return;
  const StereoRig before = input_.rig;
  input_.rig = grown(calibration::withoutRangeError(before, error), scale);
  for (ColourCamera& camera : input_.colour_cameras) camera.T_cam_left = grown(camera.T_cam_left, scale);
  prepared_->setRig(before, input_.rig);
  for (auto& plane : survey_->planes)
    if (plane) {
      // Inverse depth is linear in the ray, and all of it grows alike.
      const Eigen::Vector3d inverse =
          plane->normal / plane->distance + error.per_metre * Eigen::Vector3d::UnitZ();
      *plane = {inverse.normalized(), scale / inverse.norm()};
    }
}

const std::vector<NavigatedPose>& Dive::poses() {
  (void)localised();
  return slam_ ? slam_->poses : survey_->navigation.poses;
}

SeedPlanes Dive::planes() {
  const bool by_altitude = input_.navigated && !seesBeside(input_);
  return by_altitude ? seedPlanes(input_.mission, poses(), config_.default_altitude) : survey_->planes;
}

const ModelPlan& Dive::plan() {
  if (plan_) return *plan_;
  (void)localised();
  const std::vector<std::size_t> cameras = camerasOfTexture(input_);
  const Digest key = planKey(input_, config_, grid_, poses_content_, prepared_->content());
  const WorkFile file = single(Stage::kPlan, key, [&](WorkFileWriter& out) {
    static const std::vector<slam::NavigationLink> kNone;
    ModelPlan plan = planModel(*prepared_, lighting().left, T_nav_cam_, slam_ ? slam_->closures : kNone,
                               grid_, config_.model.division, input_.region.get());
    plan.texel = config_.model.texel;
    if (plan.texel <= 0) {
      plan.texel = pixelOf(cameras.front());
      for (const std::size_t camera : cameras) plan.texel = std::min(plan.texel, pixelOf(camera));
    }
    savePlan(out, plan);
    return Costs();
  });
  plan_ = loadPlan(file);
  for (const std::size_t number : cameras) {
    TextureCamera one{number, input_.camera(number), input_.T_cam_left(number).inverse(),
                      config_.model.blend.bands};
    // Texels larger than pixels are made from images downsampled by that ratio.
    one.bands.reduction = std::max(1, static_cast<int>(plan_->texel / pixelOf(number)));
    one.camera = one.camera.scaled(1.0 / one.bands.reduction);
    texture_cameras_.push_back(std::move(one));
  }
  return *plan_;
}

double Dive::pixelOf(std::size_t camera) const {
  return nativeTexel(input_.camera(camera), survey_->planes, config_.default_altitude);
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
  FuseResult out;
  const std::vector<NavigatedPose>& known = poses();
  const SeedPlanes planes = this->planes();
  std::vector<std::uint32_t> part_of(known.size(), 0);
  if (slam_)
    for (std::uint32_t part = 0; part < slam_->parts.size(); ++part)
      for (const std::uint32_t k : slam_->parts[part].pairs) part_of[k] = part;
  for (std::size_t k = 0; k < known.size(); ++k) {
    const PairFacts& facts = prepared_->facts()[k];
    FuseCounts& counts = out.counts;
    if (!facts.unreadable.empty()) {
      ++counts.unreadable;
      counts.unreadable_lines.push_back(facts.unreadable);
      continue;
    }
    if (!facts.placed || !known[k].T_nav_body) {
      ++counts.without_pose;
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
    pair.altitude = known[k].altitude.value_or(
        input_.navigated ? 0 : altitudeOver(*planes[k], pair.T_nav_cam, pair.T_nav_body));
    pair.part = part_of[k];
    pair.range = planes[k]->distance;
    pair.points = facts.points;
    pair.used = facts.has_mesh;
    if (pair.used) {
      const auto& box = plan().footprints[k].box;
      pair.footprint_radius = 0.5 * hypotenuse(box[2] - box[0], box[3] - box[1]);
    }
    out.pairs.push_back(std::move(pair));
  }
  return out;
}

}  // namespace fathom::topside
