#include "recon/topside/pipeline.hpp"

#include <oneapi/tbb/parallel_for.h>
#include <sys/resource.h>

#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "firmware_if/mission/feature_file.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/files/output_folder.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/progress.hpp"
#include "recon/products/rasters/layer_set.hpp"
#include "recon/products/tiles/tileset.hpp"
#include "recon/topside/assemble/assemble.hpp"
#include "recon/topside/config/thread_limit.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "recon/topside/prepare/pair_preparer.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/overlap_colours.hpp"
#include "recon/topside/report/run_record.hpp"
#include "recon/topside/report/slam_report.hpp"
#include "recon/topside/work/repair.hpp"
#include "recon/topside/work/run_stage_times.hpp"

namespace fathom::topside {
namespace {

constexpr int kPicturePixels = 1400;   // longer side of the report's pictures
constexpr double kPixelsPerVoxel = 6;  // at most: a small map is drawn large enough to look at

// What topside/ of a mission folder may hold.
constexpr std::array<std::string_view, 18> kOurs = {"stereo_pose_est.data",
                                                    "vehicle_pose_est.data",
                                                    "closures.csv",
                                                    "pose_covariances.csv",
                                                    "mesh.ply",
                                                    "mesh.png",
                                                    "tiles/tileset.json",
                                                    kTileFiles,
                                                    kLayerFiles,
                                                    "report.json",
                                                    "report.html",
                                                    "scene.json",
                                                    "track.json",
                                                    "images.json",
                                                    "images.csv",
                                                    "images_squidle.csv",
                                                    "images_catami.csv",
                                                    "images_biigle.csv"};
// Not the same twice: they tell how long the work took.
constexpr std::array<std::string_view, 2> kTimed = {"report.json", "report.html"};

[[noreturn]] void refuse(const MissionInput& input, const FuseCounts& counts, std::size_t listed) {
  std::string why = "no usable stereo pair of " + std::to_string(listed) + ": " +
                    std::to_string(counts.unreadable) + " unreadable, " +
                    std::to_string(counts.without_pose) +
                    (input.navigated ? " outside the navigation, " : " that show too little to be placed, ") +
                    std::to_string(counts.too_few_points) + " with too few points";
  if (!counts.unreadable_lines.empty()) why += "; the first: " + counts.unreadable_lines.front();
  throw InputError(input.paths.root.string(), "img", why);
}

std::size_t peakBytes() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::size_t>(usage.ru_maxrss) * 1024;
}

std::filesystem::path workOf(const RunPlaces& places) {
  return places.work.empty() ? places.mission / "topside.work" : places.work;
}

std::filesystem::path outOf(const RunPlaces& places) {
  return places.out.empty() ? places.mission / "topside" : places.out;
}

// Why a pair's files cannot be used; empty where they can.
std::string faultOf(const MissionInput& input, const ImagePair& pair) {
  try {
    if (input.features_only) {
      StereoFeatureFrame frame;
      io::readFeatureFile(input.paths.features() / io::featureFileName(pair.left), frame);
    } else {
      for (const std::size_t camera : {0U, 1U}) (void)input.image(pair, camera);
    }
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

// One thread's, to prepare one of these pairs of the survey.
double secondsToPrepare(const MissionInput& input, const TopsideConfig& config, const Survey& survey,
                        const std::vector<std::size_t>& pairs) {
  PairList sample;
  SeedPlanes planes;
  for (const std::size_t k : pairs) {
    sample.pairs.push_back(survey.list.pairs[k]);
    if (input.navigated) planes.push_back(survey.planes[k]);
  }
  if (!input.navigated) planes = scoutPlanes(input, config, sample);
  const LightingModels light(input, config.lighting);
  const auto preparer = makePreparer(input, config, light, localises(input, config));
  double seconds = 0;
  int timed = 0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (!planes[k]) continue;
    Stopwatch watch;
    (void)preparer->process(sample.pairs[k], *planes[k]);
    seconds += watch.lap();
    ++timed;
  }
  return timed == 0 ? 0 : seconds / timed;
}

void fillRecord(RunRecord& record, Dive& dive, const StageStore& store, const Assembled& model) {
  const MissionInput& input = dive.input();
  record.mission = input.paths.root.string();
  record.vehicle = input.mission.vehicle_name;
  record.dive_id = input.mission.dive_id;
  record.software_version = FATHOM_VERSION;
  record.threads = threadsOf(dive.config());
  record.config = &dive.config();
  record.list = &dive.survey().list;
  record.navigation = &dive.survey().navigation;
  record.slam = dive.localised();
  record.assumed = input.assumed;
  const LightingModels& lighting = dive.lighting();
  record.left_lighting = lighting.left.report();
  record.right_lighting = lighting.right.report();
  record.lighting_unreadable = lighting.unreadable;
  record.rig = dive.rigFinding();
  record.overlap = overlapColours(dive);
  record.water = dive.plan().light.water;
  record.by_chart = dive.input().colours.has_value();
  for (const WorkFile& file : dive.pieceFiles()) {
    const PieceFacts facts = readPieceFacts(file);
    record.fusion.triangles += facts.fusion.triangles;
    record.fusion.skipped_triangles += facts.fusion.skipped_triangles;
    record.fusion.voxel_updates += facts.fusion.voxel_updates;
    record.fusion.carved_voxels += facts.fusion.carved_voxels;
    record.fusion.blocks += facts.fusion.blocks;
    record.meshes_fused += facts.meshes;
    record.texels += facts.texels;
    record.texels_unseen += facts.unseen;
    record.texels_outvoted += facts.outvoted;
  }
  record.pieces = dive.pieceFiles().size();
  record.levels = model.levels;
  record.layers = model.layers;
  record.vertices = model.vertices;
  record.triangles = model.triangles;
  record.area = model.levels.front().area;
  for (const auto& [name, outcome] : dive.outcomes())
    record.stages.push_back({name, outcome.there, outcome.made, outcome.seconds});
  for (const auto& [item, costs] : store.costs("prepare"))
    for (const auto& [step, seconds] : costs) record.prepare_costs[step] += seconds;
  for (std::size_t level = 0; level < model.levels.size(); ++level)
    for (const auto& [item, costs] : store.costs(level == 0 ? "piece" : "level" + std::to_string(level)))
      for (const auto& [step, seconds] : costs) record.model_costs[step] += seconds;
}

std::vector<std::string> toKnow(const MissionInput& input, const RunRecord& record,
                                const FuseCounts& counts) {
  std::vector<std::string> out;
  if (record.slam != nullptr) {
    out = slamWarnings(*record.slam);
    if (const auto sentence = controlSentence(record.slam->control)) out.push_back(*sentence);
  }
  if (const auto warning = warningOf(record.rig)) out.push_back(*warning);
  if (counts.unreadable > 0)
    out.push_back(std::to_string(counts.unreadable) +
                  " pairs are unreadable; the first: " + counts.unreadable_lines.front());
  const Anchor& anchor = record.navigation->anchor;
  if (!input.placed)
    out.emplace_back("Nobody says where on the Earth the dive was: the model has metres of its own.");
  else if (anchor.source == "none")
    out.emplace_back("No position fix places the dive: the model stands at the mission's origin.");
  return out;
}

Summary runWith(const RunPlaces& places, const TopsideConfig& config) {
  Stopwatch total;
  // Bad input leaves no folders behind.
  MissionInput input = openMission(places.mission, places.input);
  sayAssumed(input);
  OutputFolder out(outOf(places), kOurs);
  StageStore store(workOf(places), StageStore::Access::kAlone);
  RunProgress progress(1.0);
  Dive dive(std::move(input), config, store, progress, Permission());
  (void)dive.prepared();
  (void)dive.localised();
  const FuseResult fused = dive.fused();
  if (fused.counts.used == 0) refuse(dive.input(), fused.counts, dive.survey().list.pairs.size());
  const std::vector<TilePlaces>& levels = dive.levels();
  if (levels.front().empty()) refuse(dive.input(), fused.counts, dive.survey().list.pairs.size());
  Stopwatch stage;
  RunRecord record;
  const Assembled model = assemble(dive, fused, out.path());
  MapPainter painter(model.extent, kPicturePixels, config.fusion.voxel / kPixelsPerVoxel);
  for (const auto& [tile, file] : levels.front()) painter.add(readFeed(*file, tile).surface.mesh);
  const MapPicture picture = painter.take();
  writeFile(out.path() / "mesh.png", toPng(picture.rgb, picture.width, picture.height));
  dive.dropOldItems();

  Summary done;
  done.pairs = dive.survey().list.pairs.size();
  done.used = fused.counts.used;
  done.unreadable = fused.counts.unreadable;
  done.triangles = model.triangles;
  for (const LevelSummary& level : model.levels) done.tiles += level.tiles;
  done.area = model.levels.front().area;
  done.content = digestOfFolder(out.path(), kTimed);
  fillRecord(record, dive, store, model);
  record.stages.push_back({"assemble", 0, 1, stage.lap()});
  record.fused = &fused;
  record.content = done.content.hex();
  record.peak_bytes = peakBytes();
  record.damaged = store.damaged();
  record.total_seconds = done.seconds = total.lap();
  writeReportJson(out.path() / "report.json", record);
  writeReportHtml(out.path() / "report.html", record, picture);
  out.commit();
  done.out = outOf(places);
  done.to_know = toKnow(dive.input(), record, fused.counts);
  return done;
}

}  // namespace

Summary runTopside(const RunPlaces& places, const TopsideConfig& config) {
  const ThreadLimit limit(config);
  return withRepair([&] { return runWith(places, config); });
}

Summary runTopside(const std::filesystem::path& mission, const std::filesystem::path& out,
                   const TopsideConfig& config) {
  RunPlaces places;
  places.mission = mission;
  places.out = out;
  places.work = out.string() + ".work";
  return runTopside(places, config);
}

RunCheck checkRun(const RunPlaces& places, const TopsideConfig& config) {
  constexpr std::size_t kLooked = 500, kTimedPairs = 5;
  const ThreadLimit limit(config);
  const MissionInput input = openMission(places.mission, places.input);
  sayAssumed(input);
  if (std::filesystem::exists(std::filesystem::absolute(outOf(places)).parent_path()))
    const OutputFolder out(outOf(places), kOurs);
  if (std::filesystem::exists(workOf(places)))
    const StageStore store(workOf(places), StageStore::Access::kAlone);
  Survey survey;
  if (input.navigated)
    survey = takeSurvey(input, config);
  else
    survey.list = pairsOf(input);
  const std::vector<ImagePair>& pairs = survey.list.pairs;
  RunCheck out{pairs.size(), survey.list.left_alone, survey.list.right_alone, 0, {}, 0};
  const std::size_t step = (pairs.size() + kLooked - 1) / kLooked;
  out.looked = (pairs.size() + step - 1) / step;
  std::vector<std::string> faults(out.looked);
  rt::StageProgress progress("looking at images", out.looked);
  oneapi::tbb::parallel_for(std::size_t{0}, out.looked, [&](std::size_t k) {
    faults[k] = faultOf(input, pairs[k * step]);
    progress.step();
  });
  std::vector<std::size_t> good, timed;
  for (std::size_t k = 0; k < out.looked; ++k)
    if (faults[k].empty())
      good.push_back(k * step);
    else
      out.unreadable.push_back(faults[k]);
  for (std::size_t k = 0; k < std::min(good.size(), kTimedPairs); ++k)
    timed.push_back(good[k * good.size() / kTimedPairs]);
  if (!input.features_only)
    out.seconds = secondsToPrepare(input, config, survey, timed) * static_cast<double>(pairs.size()) /
                  (threadsOf(config) * weightOf(Stage::kPrepare));
  return out;
}

void runOneStage(const RunPlaces& places, const TopsideConfig& config, Stage stage,
                 std::optional<std::pair<std::size_t, std::size_t>> items) {
  const ThreadLimit limit(config);
  withRepair([&] {
    MissionInput input = openMission(places.mission, places.input);
    StageStore store(workOf(places), StageStore::Access::kShared);
    RunProgress progress(expectedShare(stage));
    Dive dive(std::move(input), config, store, progress, {stage, items});
    dive.make(stage);
    return 0;
  });
}

std::string listItems(const RunPlaces& places, const TopsideConfig& config) {
  const ThreadLimit limit(config);
  MissionInput input = openMission(places.mission, places.input);
  StageStore store(workOf(places), StageStore::Access::kShared);
  RunProgress progress(1.0);
  nlohmann::ordered_json list;
  Dive dive(std::move(input), config, store, progress, {Stage::kSurvey, {}});
  list["prepare"] = dive.items(Stage::kPrepare);
  try {
    list["piece"] = dive.items(Stage::kPiece);
  } catch (const InputError&) {
    list["piece"] = nullptr;  // no plan yet
  }
  return list.dump();
}

}  // namespace fathom::topside
