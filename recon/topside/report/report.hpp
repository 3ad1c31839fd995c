#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "recon/geometry/mesh.hpp"
#include "recon/topside/report/map_picture.hpp"
#include "recon/topside/stages/fuse_stage.hpp"
#include "recon/topside/stages/image_pairs.hpp"
#include "recon/topside/stages/navigation.hpp"
#include "recon/topside/stages/slam_stage.hpp"
#include "recon/topside/topside_config.hpp"

namespace fathom::topside {

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
  fusion::VolumetricFusion::Counters fusion;
  std::size_t fusion_bytes = 0;
  std::uint64_t lighting_unreadable = 0;
  lighting::LightingModel::Report left_lighting, right_lighting;
  std::size_t vertices = 0, triangles = 0, pieces_dropped = 0;
  double area = 0;                                            // of the mesh [m^2]
  std::vector<std::pair<std::string, double>> stage_seconds;  // wall clock, in order
  double total_seconds = 0;
};

// report.json, and report.html: one page with pictures, track and tables that needs nothing else.
void writeReportJson(const std::filesystem::path& path, const RunRecord& record);
void writeReportHtml(const std::filesystem::path& path, const RunRecord& record, const MapPicture& picture);

}  // namespace fathom::topside
