// The last stages of a dive: pieces, levels, and what of the work folder they no longer need.
#include <cmath>
#include <set>

#include "realtime/base/input_error.hpp"
#include "recon/topside/dive.hpp"

namespace fathom::topside {
namespace {

// Of corrected images kept for texture, for each thread: a hundred at full size, twice what a tile is seen
// by.
constexpr std::size_t kImageBytes = std::size_t{512} << 20;

std::string pieceItem(const TileRange& core) {
  return std::to_string(core.x0) + "_" + std::to_string(core.y0) + "_" + std::to_string(core.x1) + "_" +
         std::to_string(core.y1);
}

}  // namespace

LayerCells Dive::layerCells() {
  LayerCells cells;
  cells.surface = grid_.voxel;
  // Tiles reduced by four are enough to draw it.
  cells.mosaic = std::max(cells.mosaic, TileGrid::kFanOut * plan().texel);
  return cells;
}

std::vector<StageTask> Dive::pieceTasks() {
  const ModelPlan& model = plan();
  if (textured() && !images_)
    images_ = std::make_unique<ViewImages>(input_, *survey_, *lighting_, *prepared_, model.light,
                                           texture_cameras_, kImageBytes * threadsAllowed());
  piece_inputs_.input = &input_;
  piece_inputs_.config = &config_;
  piece_inputs_.prepared = prepared_.get();
  piece_inputs_.T_nav_cam = &T_nav_cam_;
  piece_inputs_.footprints = &model.footprints;
  if (slam_) piece_inputs_.doubt = PoseDoubt(slam_->uncertain);
  piece_inputs_.statistics = &model.statistics;
  piece_inputs_.planes = &survey_->planes;
  piece_inputs_.light = &model.light;
  piece_inputs_.cameras = &texture_cameras_;
  piece_inputs_.images = images_.get();
  piece_inputs_.grid = grid_;
  piece_inputs_.texel = model.texel;
  piece_inputs_.cells = layerCells();
  std::vector<StageTask> tasks;
  for (const fusion::Piece& piece : model.pieces)
    tasks.push_back({pieceItem(piece.core),
                     pieceKey(piece_inputs_, piece, lighting_content_, image_identities_),
                     [this, &piece](WorkFileWriter& file) { return makePiece(piece_inputs_, piece, file); }});
  return tasks;
}

void Dive::makePieces() {
  if (!piece_files_.empty()) return;
  const std::vector<StageTask> tasks = pieceTasks();
  run(Stage::kPiece, nameOf(Stage::kPiece), tasks, weightOf(Stage::kPiece));
  if (permission_.only == Stage::kPiece && permission_.items) return;
  for (const StageTask& task : tasks)
    piece_files_.push_back(store_.get(nameOf(Stage::kPiece), task.item, task.key));
}

const std::vector<TilePlaces>& Dive::levels() {
  if (!levels_.empty()) return levels_;
  makePieces();
  TilePlaces places;
  for (const WorkFile& file : piece_files_) {
    const auto shared = std::make_shared<const WorkFile>(file);
    for (const TileRecord& record : readRecords(file)) places.emplace(record.tile, shared);
  }
  if (places.empty() && input_.region)
    throw InputError("--region", "", "the region has nothing of the surface that was seen");
  levels_.push_back(std::move(places));
  for (;;) {
    const TilePlaces& finer = levels_.back();
    const auto parents = parentsOf(finer);
    if (parents.empty()) break;
    std::vector<StageTask> tasks;
    const std::string name = nameOf(Stage::kLevel) + std::to_string(parents.begin()->first.level);
    for (const auto& [parent, children] : parents)
      tasks.push_back({tileName(parent), levelKey(finer, children, config_, grid_, plan_->texel),
                       [&, parent = parent, children = children](WorkFileWriter& file) {
                         return makeParent(finer, parent, children, config_, grid_, plan_->texel, file);
                       }});
    // The parents of a level are about a sixteenth of their children.
    run(Stage::kLevel, name, tasks, weightOf(Stage::kLevel) * std::pow(1.0 / 16, levels_.size() - 1));
    TilePlaces coarser;
    std::size_t k = 0;
    for (const auto& [parent, children] : parents) {
      coarser.emplace(parent,
                      std::make_shared<const WorkFile>(store_.get(name, tasks[k].item, tasks[k].key)));
      ++k;
    }
    levels_.push_back(std::move(coarser));
  }
  return levels_;
}

void Dive::dropOldItems() {
  std::set<std::string> items;
  for (const fusion::Piece& piece : plan().pieces) items.insert(pieceItem(piece.core));
  store_.keepOnly(nameOf(Stage::kPiece), items);
  for (std::size_t level = 1; level < levels().size(); ++level) {
    items.clear();
    for (const auto& [tile, file] : levels()[level]) items.insert(tileName(tile));
    store_.keepOnly(nameOf(Stage::kLevel) + std::to_string(level), items);
  }
}

}  // namespace fathom::topside
