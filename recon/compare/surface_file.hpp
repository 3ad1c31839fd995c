#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "recon/compare/height_map.hpp"

namespace fathom::compare {

// A surface that somebody measured, in whatever form it is stored.
class SurfaceFile {
 public:
  virtual ~SurfaceFile() = default;
  [[nodiscard]] virtual PlaneFrame frame() const = 0;
  // In `to`; empty where it holds nothing.
  [[nodiscard]] virtual Box bounds(const PlaneFrame& to) const = 0;
  // Mean distance of neighbouring heights [m], in `to`.
  [[nodiscard]] virtual double spacing(const PlaneFrame& to) const = 0;
  // What of it lies in `box` of `to`, in cells (HeightMap's constructor says where they lie).
  [[nodiscard]] virtual HeightMap read(const PlaneFrame& to, const Box& box, double cell) const = 0;
  // What was read, in a few words.
  [[nodiscard]] const std::string& about() const { return about_; }

 protected:
  std::string about_;
};

// The frame of a mesh by the files that lie beside it; not known where none says so.
using FrameBeside = std::function<PlaneFrame(const std::filesystem::path& mesh)>;

// Opens
//   a folder of fathom-topside      its layers/elevation.tif, else its mesh.ply
//   .ply                            a mesh in nav, which lies where `beside` says
//   .xyz .txt .csv .pts and the like   text: x y z a line (XYZ of gridded multibeam)
//   anything else                   what GDAL opens: GeoTIFF, ASCII grid, BAG, netCDF
// `crs`: of a file that does not say (empty: the frame stays unknown). Throws InputError.
[[nodiscard]] std::unique_ptr<SurfaceFile> openSurface(const std::filesystem::path& path,
                                                       const std::string& crs, const FrameBeside& beside);

// The makers of each kind.
[[nodiscard]] std::unique_ptr<SurfaceFile> openMesh(const std::filesystem::path& path, const std::string& crs,
                                                    const FrameBeside& beside);
[[nodiscard]] std::unique_ptr<SurfaceFile> openRaster(const std::filesystem::path& path,
                                                      const std::string& crs);
[[nodiscard]] std::unique_ptr<SurfaceFile> openPoints(const std::filesystem::path& path,
                                                      const std::string& crs);

}  // namespace fathom::compare
