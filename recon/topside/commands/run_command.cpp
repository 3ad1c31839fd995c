#include "recon/topside/commands/run_command.hpp"

#include <charconv>
#include <cstdio>
#include <memory>
#include <optional>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/commands/calib_options.hpp"
#include "recon/topside/commands/sample_options.hpp"
#include "recon/topside/pipeline.hpp"

namespace fathom::topside {
namespace {

struct Options {
  RunPlaces places;
  std::filesystem::path config;
  std::optional<double> resolution, texel;
  std::optional<int> features, jobs;
  bool dense = false, no_slam = false, no_texture = false;
  std::string textures = "jpeg", mode = "bands", only, items;
  bool list = false;
};

void addOptions(CLI::App& command, Options& o) {
  command
      .add_option("mission", o.places.mission,
                  "mission folder, or any folder of stereo images with a calibration")
      ->required();
  command.add_option("--work", o.places.work, "folder for what the stages hand on (MISSION/topside.work)");
  command.add_option("--config", o.config, "TOML file; keys are in recon/topside/README.md");
  command.add_option("--jobs,--threads", o.jobs, "threads (all cores); the result does not depend on them")
      ->check(CLI::Range(1, 256));
  command.add_option("--resolution,--voxel", o.resolution, "edge of a voxel [m] (0.033)")
      ->check(CLI::Range(0.004, 2.0));
  command.add_option("--texel", o.texel, "finest texel [m] (a pixel's size on the ground)")
      ->check(CLI::Range(0.0001, 1.0));
  command.add_option("--features", o.features, "corners or dense points wanted in an image (800)")
      ->check(CLI::Range(20, 5000));
  command.add_flag("--dense", o.dense, "semi-global matching instead of corners");
  command.add_flag("--no-slam", o.no_slam, "dead-reckoned poses: no visual odometry, no loop closures");
  command.add_flag("--no-texture", o.no_texture, "colours by vertex alone");
  command
      .add_option("--textures", o.textures, "in the tiles, JPEG or WebP; or JPEG and BC1 beside it for GPUs")
      ->check(CLI::IsMember({"jpeg", "webp", "ktx2", "dds"}));
  command.add_option("--mode", o.mode, "how images are blended")
      ->check(CLI::IsMember({"bands", "average", "unblended"}));
  addCalibOptions(command, o.places.input.calib, o.places.input.calib_unit,
                  "instead of the folder's own calibration");
  command.add_option("--poses", o.places.input.poses,
                     "stereo_pose_est.data: take poses from there instead of localising");
  StereoFileOptions& files = o.places.input.files;
  command.add_option("--left", files.left_pattern,
                     "shell pattern of the left images, in quotes (a folder without mission.toml: by names)");
  command.add_option("--right", files.right_pattern, "shell pattern of the right images");
  command.add_option("--pairs", files.pairs, "CSV file instead: columns left, right and, if known, utc");
  command.add_option("--time-pattern", files.time_pattern,
                     "of the left images' names, as 'img_%Y%m%d_%H%M%S_%f' (the usual ones are known)");
  addSampleOptions(command, o.places.input.left_format, o.places.input.right_format);
  command.add_flag("--verify", o.places.input.verify, "tell images apart by content, not by size and time");
}

TopsideConfig configOf(Options& o) {
  TopsideConfig config = o.config.empty() ? TopsideConfig{} : readTopsideConfig(o.config);
  if (o.resolution) setVoxel(config, *o.resolution);
  if (o.texel) config.model.texel = *o.texel;
  if (o.no_slam) config.slam = false;
  if (o.no_texture) config.model.texture = false;
  if (o.dense) config.dense_stereo = true;
  if (o.features) config.stereo.max_features = *o.features;
  if (o.jobs) config.threads = *o.jobs;
  if (o.textures == "webp") config.model.picture.format = PictureFormat::kWebp;
  if (o.textures == "ktx2") config.model.gpu_texture = GpuTexture::kKtx2;
  if (o.textures == "dds") config.model.gpu_texture = GpuTexture::kDds;
  if (o.mode == "average") config.model.blend.mode = surface::BlendMode::kAverage;
  if (o.mode == "unblended") config.model.blend.mode = surface::BlendMode::kUnblended;
  o.places.input.files.tolerance = config.pairing_tolerance;
  return config;
}

Stage stageOf(const std::string& name) {
  if (const auto stage = stageNamed(name)) return *stage;
  std::string names;
  for (const char* known : kStageNames) names += (names.empty() ? "" : ", ") + std::string(known);
  throw InputError(name, "", "no such stage; the stages are " + names);
}

// "7" or "0-15", both ends taken.
std::optional<std::pair<std::size_t, std::size_t>> itemsOf(const std::string& text) {
  if (text.empty()) return std::nullopt;
  std::size_t first = 0, last = 0;
  const char* end = text.data() + text.size();
  auto read = std::from_chars(text.data(), end, first);
  last = first;
  if (read.ec == std::errc() && read.ptr != end && *read.ptr == '-')
    read = std::from_chars(read.ptr + 1, end, last);
  if (read.ec != std::errc() || read.ptr != end || last < first)
    throw InputError("--piece", text, "give a number, or two as in 0-15");
  return std::pair(first, last + 1);
}

int runAll(Options& o) {
  const TopsideConfig config = configOf(o);
  if (!o.only.empty() && o.only != "assemble") {
    runOneStage(o.places, config, stageOf(o.only), std::nullopt);
    return kExitSuccess;
  }
  const Summary done = runTopside(o.places, config);
  std::printf("%zu of %zu pairs in the map (%zu unreadable): %.1f m2, %zu triangles, %zu tiles, %.1f s\n",
              done.used, done.pairs, done.unreadable, done.area, done.triangles, done.tiles, done.seconds);
  std::printf("content %s\n", done.content.hex().c_str());
  return kExitSuccess;
}

}  // namespace

std::vector<Command> addRunCommands(CLI::App& app) {
  const auto o = std::make_shared<Options>();
  CLI::App* run = app.add_subcommand("run", "from a recorded dive to a model that people explore");
  run->footer("Example: fathom-topside run missions/reef-grid --jobs 2");
  addOptions(*run, *o);
  run->add_option("--out", o->places.out, "folder for the results (MISSION/topside)");
  run->add_option("--only", o->only, "one stage, from those before it, into the work folder");
  CLI::App* stage = app.add_subcommand("stage", "one stage of a run, or some of its items");
  stage->footer("Example: fathom-topside stage piece missions/reef-grid --piece 0-15");
  stage->add_option("stage", o->only, "survey, lighting, prepare, localise, plan, piece or level")
      ->required();
  addOptions(*stage, *o);
  stage->add_option("--piece", o->items, "of prepare and piece: a number from 0, or two as in 0-15");
  CLI::App* plan = app.add_subcommand("plan", "how many items the stages of a run have");
  plan->footer("Example: fathom-topside plan missions/reef-grid");
  addOptions(*plan, *o);
  plan->add_flag("--list", o->list, "as JSON, and nothing else (the default)");
  return {{run, [o] { return runAll(*o); }},
          {stage,
           [o] {
             runOneStage(o->places, configOf(*o), stageOf(o->only), itemsOf(o->items));
             return kExitSuccess;
           }},
          {plan, [o] {
             std::printf("%s\n", listItems(o->places, configOf(*o)).c_str());
             return kExitSuccess;
           }}};
}

}  // namespace fathom::topside
