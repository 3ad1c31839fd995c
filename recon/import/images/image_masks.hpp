#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "recon/geometry/camera.hpp"
#include "recon/geometry/image_view.hpp"
#include "recon/import/images/image_pairs.hpp"

namespace fathom::topside {

// Masks as users of other programs have them: pictures of an image's size, black where it shows parts of the
// vehicle or its frame. Thread-safe.
class ImageMasks {
 public:
  // `path`: one picture for all images of both cameras, or a folder: left.* and right.* (colour.*, colour2.*
  // ... of colour cameras) for all of a camera, and, in the images' folders, for the image NAME.EXT
  // NAME.EXT.png (as COLMAP has them), NAME_mask.* (as Metashape and ODM do) or NAME.*. Where there are both
  // kinds, an image is masked by both. Throws InputError for a path that has no picture, and for one of all
  // images that cannot be read, has another size than the camera, or hides everything.
  ImageMasks(const std::filesystem::path& path, std::vector<Camera> cameras);

  // Null: nothing is hidden. Throws InputError for a picture that cannot be read or has another size.
  [[nodiscard]] std::shared_ptr<const ImageMask> of(const std::string& image, std::size_t camera) const;
  // The picture of this image alone; empty: there is none.
  [[nodiscard]] std::filesystem::path fileOf(const std::string& image) const;
  // Those of all images, by camera; empty: there is none.
  [[nodiscard]] const std::vector<std::filesystem::path>& filesOfAll() const { return all_files_; }
  [[nodiscard]] std::vector<std::filesystem::path> files() const;
  // Throws InputError where no picture is of any of these images.
  void requireUse(const PairList& list) const;

 private:
  std::filesystem::path path_;
  std::vector<Camera> cameras_;  // left, right, colour cameras
  std::vector<std::filesystem::path> all_files_;
  std::vector<std::shared_ptr<const ImageMask>> all_;
  std::map<std::string, std::filesystem::path> single_;  // by the image's name, with or without its ending
};

// What a mask hides of an image of 8 bits and so many interleaved channels, replaced by what is around it,
// smoothly: nothing there catches the eye of a detector or bleeds into means of the surroundings.
void fillHidden(std::uint8_t* samples, int channels, const ImageMask& mask);

}  // namespace fathom::topside
