#include "recon/topside/plan/plan_stage.hpp"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"

#include "recon/topside/work/saved_bytes.hpp"

namespace fathom::fusion {

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<MeshFootprint> auto& footprint) {
  archive(footprint.box);
}

template <typename Archive>
void exchangeState(Archive& archive, topside::Is<Piece> auto& piece) {
  archive(piece.core.x0, piece.core.y0, piece.core.x1, piece.core.y1, piece.meshes);
}

}  // namespace fathom::fusion

namespace fathom::topside {
namespace {

constexpr std::uint32_t kPlanVersion = 4;  // changes with the result
constexpr double kTexelStep = 0.0001;      // [m]
constexpr fusion::MeshFootprint kNowhere{{1, 1, 0, 0}};

fusion::MeshFootprint footprintOf(const Mesh& mesh) {
  if (mesh.vertices.empty()) return kNowhere;
  Eigen::Vector2f low = mesh.vertices[0].head<2>(), high = low;
  for (const auto& v : mesh.vertices) {
    low = low.cwiseMin(v.head<2>());
    high = high.cwiseMax(v.head<2>());
  }
  return {{static_cast<double>(low.x()), static_cast<double>(low.y()), static_cast<double>(high.x()),
           static_cast<double>(high.y())}};
}

void keepPiecesOf(const Region& region, const TileGrid& grid, ModelPlan& plan) {
  const double edge = grid.edge(0);
  Eigen::AlignedBox2d seen;  // by all pieces
  std::erase_if(plan.pieces, [&](const fusion::Piece& piece) {
    const Eigen::AlignedBox2d box(edge * Eigen::Vector2d(piece.core.x0, piece.core.y0),
                                  edge * Eigen::Vector2d(piece.core.x1, piece.core.y1));
    seen.extend(box);
    return !region.mayMeet(box);
  });
  if (!plan.pieces.empty()) return;
  const auto about = [](const Eigen::AlignedBox2d& box) {
    return formatted("north %.1f to %.1f m, east %.1f to %.1f m", box.min().x(), box.max().x(), box.min().y(),
                     box.max().y());
  };
  throw InputError(
      "--region", "",
      "the region (" + about(region.box()) + ") has nothing of what was seen (" + about(seen) + ")");
}

}  // namespace

std::vector<SE3> cameraPoses(const std::vector<NavigatedPose>& poses, const SE3& T_body_cam) {
  std::vector<SE3> out;
  for (const NavigatedPose& pose : poses)
    out.push_back(pose.T_nav_body ? *pose.T_nav_body * T_body_cam : SE3());
  return out;
}

ModelPlan planModel(const PreparedGroups& prepared, const lighting::LightingModel& lighting,
                    const std::vector<SE3>& T_nav_cam, const std::vector<slam::NavigationLink>& closures,
                    const TileGrid& grid, const fusion::DivisionConfig& division, const Region* region) {
  const std::size_t pairs = T_nav_cam.size();
  ModelPlan plan;
  plan.footprints.assign(pairs, kNowhere);
  std::vector<fusion::CellStatistics> of_groups(groupsOf(pairs));
  oneapi::tbb::parallel_for(std::size_t{0}, of_groups.size(), [&](std::size_t group) {
    for (std::size_t k = group * kPairsInGroup; k < std::min(pairs, (group + 1) * kPairsInGroup); ++k) {
      if (!prepared.facts()[k].has_mesh) continue;
      Mesh mesh = prepared.mesh(k);
      transform(mesh, T_nav_cam[k]);
      plan.footprints[k] = footprintOf(mesh);
      of_groups[group].add(mesh);
    }
  });
  for (fusion::CellStatistics& group : of_groups) {
    plan.statistics.merge(group);
    group = fusion::CellStatistics();
  }
  std::vector<std::pair<std::uint32_t, std::uint32_t>> joined;
  for (const slam::NavigationLink& link : closures)
    if (link.kept) joined.emplace_back(link.a, link.b);
  plan.light = groundLight(prepared, lighting, T_nav_cam, joined);
  plan.pieces = fusion::divideSpace(plan.footprints, joined, grid, division);
  if (region != nullptr) keepPiecesOf(*region, grid, plan);
  return plan;
}

double nativeTexel(const Camera& camera, const SeedPlanes& planes, double default_range) {
  std::vector<double> ranges;
  for (const auto& plane : planes)
    if (plane) ranges.push_back(plane->distance);
  const double range = median(std::move(ranges), default_range);
  return std::max(1.0, std::round(range / camera.fx / kTexelStep)) * kTexelStep;
}

Digest planKey(const MissionInput& input, const TopsideConfig& config, const TileGrid& grid,
               const Digest& poses, const Digest& prepared) {
  const fusion::DivisionConfig& division = config.model.division;
  Hasher hasher;
  hasher.add("plan", kPlanVersion, poses, prepared, grid.voxel, grid.leaf_voxels, config.model.texel,
             division.target_meshes, division.max_meshes, division.overlap);
  addRig(hasher, input);
  if (input.region) hasher.add(input.region->identity());
  return hasher.finish();
}

void savePlan(WorkFileWriter& file, const ModelPlan& plan) {
  file.add("plan", savedBytes([&](rt::StateWriter& writer) {
             writer(plan.footprints, plan.pieces, plan.statistics.save(), plan.light, plan.texel);
           }));
}

ModelPlan loadPlan(const WorkFile& file) {
  const Bytes bytes = file.read("plan");
  rt::StateReader reader(bytes);
  ModelPlan plan;
  Bytes statistics;
  if (!reader(plan.footprints, plan.pieces, statistics, plan.light, plan.texel) ||
      !plan.statistics.load(statistics))
    throw DamagedWork(file.path());
  return plan;
}

}  // namespace fathom::topside
