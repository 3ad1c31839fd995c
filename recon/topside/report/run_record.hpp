#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/topside/assemble/assemble.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/navigation.hpp"
#include "recon/topside/localise/slam_stage.hpp"
#include "recon/topside/prepare/rig_finding.hpp"
#include "recon/topside/report/overlap_colours.hpp"

namespace fathom::topside {

// One stage of the run: how many of its results were there, how many were made, and how long that took.
struct StageLine {
  std::string name;
  std::size_t there = 0, made = 0;
  double seconds = 0;  // wall clock
};

// Everything that a run has to tell.
struct RunRecord {
  std::string mission;  // folder, as given
  std::string vehicle;
  int dive_id = 0;
  std::string software_version;
  int threads = 0;
  const TopsideConfig* config = nullptr;
  const PairList* list = nullptr;
  const Navigation* navigation = nullptr;
  const FuseResult* fused = nullptr;
  const SlamResult* slam = nullptr;  // null: dead reckoning
  std::vector<std::string> assumed;  // of a folder that no mission.toml describes
  fusion::VolumetricFusion::Counters fusion;
  std::size_t meshes_fused = 0;  // a mesh counts in every piece that it reaches
  std::uint64_t texels = 0, texels_unseen = 0, texels_outvoted = 0;
  std::uint64_t lighting_unreadable = 0;
  RigFinding rig;
  lighting::LightingModel::Report left_lighting, right_lighting;
  OverlapColours overlap;
  lighting::WaterLaw water;  // see GroundLight
  bool by_chart = false;     // colours have a chart's matrix
  std::size_t pieces = 0;
  std::vector<LevelSummary> levels;
  std::vector<LayerInfo> layers;
  std::size_t vertices = 0, triangles = 0;
  double area = 0;  // of the mesh [m^2]
  std::vector<StageLine> stages;
  // Seconds of threads by step, when the results were made: of all pairs; of all tiles.
  std::map<std::string, double> prepare_costs, model_costs;
  double total_seconds = 0;
  std::size_t peak_bytes = 0;  // of the process
  std::size_t damaged = 0;     // work files that were found damaged and made again
  std::string content;         // digest of all that was written but the report
};

// report.json, and report.html: one page with pictures, track and tables that needs nothing else.
void writeReportJson(const std::filesystem::path& path, const RunRecord& record);
void writeReportHtml(const std::filesystem::path& path, const RunRecord& record, const MapPicture& picture);

}  // namespace fathom::topside
