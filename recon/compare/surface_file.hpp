#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "recon/compare/plane_frame.hpp"

namespace fathom::compare {

// A measured surface in a file of any supported kind.
class SurfaceFile {
 public:
  virtual ~SurfaceFile() = default;
  [[nodiscard]] virtual PlaneFrame frame() const = 0;
  // Its box in `to`; empty without heights.
  [[nodiscard]] virtual Box bounds(const PlaneFrame& to) const = 0;
  // Mean distance of neighbouring heights [m], in `to`.
  [[nodiscard]] virtual double spacing(const PlaneFrame& to) const = 0;
  // The part in `box` of `to`, in cells as placed by HeightMap's constructor.
  [[nodiscard]] virtual HeightMap read(const PlaneFrame& to, const Box& box, double cell) const = 0;
  // Kind of the file, in a few words.
  [[nodiscard]] const std::string& about() const { return about_; }

 protected:
  std::string about_;
};

// The frame of a mesh by the files beside it; unknown without such a file.
using FrameBeside = std::function<PlaneFrame(const std::filesystem::path& mesh)>;

// Opens
//   a folder of fathom-topside      its layers/elevation.tif, else its mesh.ply
//   .ply                            a mesh in nav, with its frame from `beside`
//   .xyz .txt .csv .pts and the like   text: x y z a line (XYZ of gridded multibeam)
//   anything else                   rasters of GDAL: GeoTIFF, ASCII grid, BAG, netCDF
// `crs`: of a file without a frame of its own (empty: it stays unknown). Throws InputError.
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
