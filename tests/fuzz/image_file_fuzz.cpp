#include "firmware_if/mission/images/image_file.hpp"

#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as an image file, and as the name of one.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile file("image.tif");
  const std::string name(reinterpret_cast<const char*>(data), size);
  if (const auto parsed = io::parseImageFileName(name)) {
    if (io::imageFileName(parsed->utc_ns, parsed->side) != name) __builtin_trap();
  }
  file.write(data, size);
  fuzz::readsOrRefuses([] {
    const io::ImageFile image = io::readImage(file.path(), PixelFormat::kMono, 12);
    if (image.bytes.size() < image.view.stride * static_cast<std::size_t>(image.view.height))
      __builtin_trap();
  });
  fuzz::readsOrRefuses([] { static_cast<void>(io::readImage(file.path(), PixelFormat::kRgb, 8)); });
  fuzz::readsOrRefuses([] { static_cast<void>(io::readAnyImage(file.path())); });
  return 0;
}
