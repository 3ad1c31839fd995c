#pragma once

#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <optional>

#include "firmware_if/mission.hpp"
#include "recon/geometry/mesh.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/surface/blend.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/light/pair_images.hpp"

namespace fathom::surface {

// A mission that fathom-topside has been over: its mesh, its poses, and the images behind them, read and
// corrected when they are asked for.
class TexturedSurvey {
 public:
  // `model`: a folder with mesh.ply, stereo_pose_est.data and vehicle_pose_est.data. Throws InputError.
  TexturedSurvey(const std::filesystem::path& mission, const std::filesystem::path& model);

  [[nodiscard]] const Camera& camera() const { return input_.rig.left; }
  [[nodiscard]] const ViewIndex& index() const { return *index_; }
  [[nodiscard]] const Mesh& mesh() const { return mesh_; }
  // The part of the mesh within a box (north, east low, then high), faces by their middles; simplified.
  [[nodiscard]] TileMesh tileAt(const std::array<double, 4>& box, double triangles_per_m2) const;
  [[nodiscard]] std::shared_ptr<const BandImage> bandsOf(std::uint32_t image, const BandWidths& widths);
  [[nodiscard]] double readSeconds() const { return read_seconds_; }
  [[nodiscard]] double bandSeconds() const { return band_seconds_; }
  [[nodiscard]] std::size_t imagesMade() const { return made_; }

 private:
  topside::MissionInput input_;
  topside::TopsideConfig config_;
  topside::LightingModels models_;
  std::optional<topside::PairImages> images_;
  std::vector<topside::ImagePair> pairs_;
  std::vector<double> altitudes_;
  std::vector<SE3> poses_;
  Mesh mesh_;
  std::optional<ViewIndex> index_;
  std::map<std::pair<std::uint32_t, bool>, std::shared_ptr<const BandImage>> kept_;  // image, restored
  std::list<std::pair<std::uint32_t, bool>> order_;                                  // latest first
  double read_seconds_ = 0, band_seconds_ = 0;
  std::size_t made_ = 0;
};

}  // namespace fathom::surface
