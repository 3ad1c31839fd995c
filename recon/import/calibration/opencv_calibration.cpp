#include "recon/import/calibration/opencv_calibration.hpp"

#include <algorithm>
#include <cctype>
#include <map>

#include "realtime/base/text.hpp"
#include "recon/import/calibration/calibration_tree.hpp"
#include "recon/import/csv_columns.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;
using Names = std::vector<std::string>;
using Counts = std::vector<std::size_t>;

// Words for each camera, the usual first, and for one more of the kind.
struct Sides {
  std::string left, right, third;
};
const std::array kSides = {Sides{"1", "2", "3"},
                           Sides{"left", "right", ""},
                           Sides{"l", "r", ""},
                           Sides{"camera1", "camera2", "camera3"},
                           Sides{"cam1", "cam2", "cam3"},
                           Sides{"leftcamera", "rightcamera", ""},
                           Sides{"cameraleft", "cameraright", ""},
                           Sides{"0", "1", "2"},
                           Sides{"camera0", "camera1", "camera2"},
                           Sides{"cam0", "cam1", "cam2"}};
const Names kMatrix{"k",          "m",         "cameramatrix",     "intrinsicmatrix",
                    "intrinsics", "intrinsic", "cameraintrinsics", "mtx"};
const Names kDistortion{"d",          "distcoeffs", "distcoeff", "distortioncoefficients", "distortioncoeffs",
                        "distortion", "dist"};
const Names kRotation{"r", "rotation", "rotationmatrix", "rmat", "stereor", "om", "rvec"};
const Names kTranslation{"t", "translation", "translationvector", "stereot", "tvec"};
const Names kImageSize{"imagesize", "imgsize", "size", "resolution"};
const Names kWidth{"imagewidth", "width"}, kHeight{"imageheight", "height"};

// Where a word stands in a name, whatever its case.
std::size_t placeIn(const std::string& name, const std::string& word) {
  std::string lower = name;
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return lower.rfind(word);
}

struct Entry {
  CalibrationPlace place;
  const CalibrationTree* value;
};

// Everything in a file, by its names without what varies.
class Entries {
 public:
  void add(const CalibrationTree& map, const CalibrationPlace& above) {
    if (!map.is_object()) return;
    for (const auto& item : map.items()) {
      const CalibrationPlace place = above.at(item.key());
      if (item.value().is_object() && !item.value().contains("data"))
        add(item.value(), place);
      else
        entries_.emplace(plainName(place.key), Entry{place, &item.value()});
    }
  }

  // The one of a camera, or of both where `side` is "": with one of these counts of numbers, else with any.
  [[nodiscard]] const Entry* find(const Names& names, const std::string& side, const Counts& counts) const {
    const Entry* other = nullptr;
    for (const std::string& name : names)
      for (const std::string& key : {name + side, side + name}) {
        const auto [begin, end] = entries_.equal_range(key);
        for (auto entry = begin; entry != end; ++entry) {
          if (has(entry->second, counts)) return &entry->second;
          if (other == nullptr && entry->second.value->is_structured()) other = &entry->second;
        }
      }
    return other;
  }

  [[nodiscard]] const Sides* sides() const {
    for (const Sides& sides : kSides)
      if (find(kMatrix, sides.left, {9}) != nullptr && find(kMatrix, sides.right, {9}) != nullptr)
        return &sides;
    return nullptr;
  }
  // "found cameraMatrix, cameraMatrix2; missing cameraMatrix1", where only one side's is there.
  [[nodiscard]] std::string matricesFound() const {
    std::string found, missing;
    for (const auto& [name, entry] : entries_)
      if (has(entry, {9}) && std::find(kRotation.begin(), kRotation.end(), name) == kRotation.end())
        found += (found.empty() ? "" : ", ") + entry.place.key;
    for (const Sides& sides : kSides)
      for (const auto& [here, there] :
           {std::pair(sides.left, sides.right), std::pair(sides.right, sides.left)}) {
        const Entry* one = find(kMatrix, here, {9});
        if (!missing.empty() || one == nullptr || !has(*one, {9})) continue;
        const std::string& key = one->place.key;
        const std::size_t at = placeIn(key, here);
        if (at != std::string::npos) missing = key.substr(0, at) + there + key.substr(at + here.size());
      }
    return (found.empty() ? "found none" : "found " + found) +
           (missing.empty() ? "" : "; missing " + missing);
  }
  [[nodiscard]] const Entry* rotation() const { return find(kRotation, "", {9, 3}); }
  [[nodiscard]] const Entry* translation() const { return find(kTranslation, "", {3}); }
  [[nodiscard]] bool hasMotion() const { return rotation() != nullptr && translation() != nullptr; }

  void refuseOtherLenses() const {
    for (const auto& [name, entry] : entries_) {
      if (!entry.value->is_string() || !name.ends_with("model")) continue;
      const auto model = entry.value->get<std::string>();
      for (const char* other : {"fisheye", "equidistant", "kannala", "omni", "mei"})
        if (plainName(model).find(other) != std::string::npos)
          entry.place.fail("lens model '" + model + "' is not known; calibrate with k1 k2 p1 p2 k3");
    }
  }

  static bool has(const Entry& entry, const Counts& counts) {
    const auto numbers = numbersOf(*entry.value);
    return numbers && std::find(counts.begin(), counts.end(), numbers->size()) != counts.end();
  }

 private:
  std::multimap<std::string, Entry> entries_;
};

void setSizeOf(Camera& camera, const Entries& entries, const std::string& side) {
  for (const std::string& of : {side, std::string()}) {
    if (const Entry* size = entries.find(kImageSize, of, {2}))
      return setSize(camera, numbersOf(*size->value, 2, size->place), size->place);
    const Entry* width = entries.find(kWidth, of, {1});
    const Entry* height = entries.find(kHeight, of, {1});
    if (width == nullptr || height == nullptr) continue;
    return setSize(
        camera,
        {numbersOf(*width->value, 1, width->place)[0], numbersOf(*height->value, 1, height->place)[0]},
        width->place);
  }
}

// `off`: raised to how far the camera is off what the file says [px].
Camera opencvCamera(const Entries& entries, const CalibrationPlace& file, const std::string& side,
                    double& off) {
  const Entry* matrix = entries.find(kMatrix, side, {9});
  Camera camera = cameraOf(numbersOf(*matrix->value, 9, matrix->place), matrix->place);
  const Entry* distortion = entries.find(kDistortion, side, {4, 5, 8, 12, 14});
  if (distortion == nullptr)
    file.fail("gives no distortion (D1, D2) beside " + matrix->place.key +
              "; write zeros where there is none");
  const auto numbers = numbersOf(*distortion->value);
  if (!numbers) distortion->place.fail("holds something else than finite numbers");
  setSizeOf(camera, entries, side);
  off = std::max(off, setDistortion(camera, *numbers, distortion->place));
  return camera;
}

}  // namespace

bool isOpenCvCalibration(const CalibrationTree& tree) {
  Entries entries;
  entries.add(tree, {});
  if (const Sides* sides = entries.sides();
      sides != nullptr && (Entries::has(*entries.find(kMatrix, sides->left, {9}), {9}) ||
                           Entries::has(*entries.find(kMatrix, sides->right, {9}), {9})))
    return true;
  return entries.hasMotion() && Entries::has(*entries.rotation(), {9, 3}) &&
         Entries::has(*entries.translation(), {3});
}

fs::path openCvPartner(const fs::path& file) {
  std::string name = file.filename().string();
  for (const auto& [one, other] :
       {std::pair<std::string, std::string>{"ntrinsic", "xtrinsic"}, {"NTRINSIC", "XTRINSIC"}})
    for (const auto& [from, to] : {std::pair("i" + one, "e" + other),
                                   {"I" + one, "E" + other},
                                   {"e" + other, "i" + one},
                                   {"E" + other, "I" + one}})
      if (const std::size_t at = name.find(from); at != std::string::npos)
        return file.parent_path() / name.replace(at, from.size(), to);
  return {};
}

CameraPair readOpenCvCalibration(const fs::path& file, const CalibrationTree& tree) {
  const CalibrationPlace place{file};
  CameraPair pair;
  pair.about = "OpenCV " + file.filename().string();
  Entries entries;
  entries.add(tree, place);
  CalibrationTree beside;
  const fs::path partner = openCvPartner(file);
  if ((entries.sides() == nullptr || !entries.hasMotion()) && fs::is_regular_file(partner)) {
    beside = parseCalibrationTree(readCalibrationText(partner), partner);
    entries.add(beside, {partner});
    pair.about += " and " + partner.filename().string();
  }
  const Sides* sides = entries.sides();
  if (sides == nullptr)
    place.fail("gives no pair of camera matrices (K1, K2), 3 x 3: " + entries.matricesFound() +
               "; put the intrinsics file beside it");
  if (!entries.hasMotion())
    place.fail(
        "gives no R and T between the cameras; put the extrinsics file beside it, named alike, or write all "
        "of "
        "K1 D1 K2 D2 R T into one");
  if (const Entry* third = entries.find(kMatrix, sides->third, {9});
      !sides->third.empty() && third != nullptr && Entries::has(*third, {9}))
    place.fail("holds the cameras " + sides->left + ", " + sides->right + ", " + sides->third +
               "; leave the two of one pair in it");
  entries.refuseOtherLenses();
  double off = 0;
  pair.left = opencvCamera(entries, place, sides->left, off);
  pair.right = opencvCamera(entries, place, sides->right, off);
  const Entry &r = *entries.rotation(), &t = *entries.translation();
  const auto rotation = numbersOf(*r.value);
  if (!rotation || (rotation->size() != 9 && rotation->size() != 3))
    r.place.fail("holds neither a rotation matrix nor a rotation vector");
  pair.T_right_left = motionOf(*rotation, r.place, numbersOf(*t.value, 3, t.place));
  pair.about += " (left " + entries.find(kMatrix, sides->left, {9})->place.key + ", right " +
                entries.find(kMatrix, sides->right, {9})->place.key + ")";
  if (off > 0)
    pair.about += ", rational lenses taken as k1 k2 p1 p2 k3, " + decimals(off, 3) + " px off at most";
  return pair;
}

}  // namespace fathom::topside
