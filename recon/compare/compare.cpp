#include "recon/compare/compare.hpp"

#include <algorithm>
#include <cmath>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/surface_file.hpp"

namespace fathom::compare {
namespace {

constexpr double kMostCellsOfMap = 16e6;  // of the survey's map; coarser beyond

// A frame in metres for a survey that is stored in degrees.
PlaneFrame metricFrame(const SurfaceFile& survey) {
  const PlaneFrame own = survey.frame();
  if (!isGeographic(own)) return own;
  const Box box = survey.bounds(own);
  return localFrame(
      {0.5 * (box.south + box.north) * kRadiansPerDegree, 0.5 * (box.west + box.east) * kRadiansPerDegree});
}

void turn(HeightMap& map) {
  for (float& h : map.up) h = -h;
}

Box grown(const Box& box, double by) {
  return {box.west - by, box.south - by, box.east + by, box.north + by};
}

bool meet(const Box& a, const Box& b) {
  return a.west < b.east && b.west < a.east && a.south < b.north && b.south < a.north;
}

std::string boxText(const Box& box) {
  return formatted("east %.1f to %.1f, north %.1f to %.1f m", box.west, box.east, box.south, box.north);
}

}  // namespace

Comparison compareSurfaces(const CompareOptions& options) {
  Comparison c;
  c.options = options;
  const auto survey = openSurface(options.survey, "", options.beside);
  const auto reference = openSurface(options.reference, options.reference_crs, options.beside);
  c.survey_about = survey->about();
  c.reference_about = reference->about();
  c.plane = metricFrame(*survey);
  if (!c.plane.known() && reference->frame().known()) {
    if (isGeographic(reference->frame()) || !options.reference_crs.empty())
      throw InputError(
          options.survey.string(), "",
          "does not state its position on Earth; keep stereo_pose_est.data or mission.toml beside it");
    c.notes.push_back("the survey does not state its position on Earth: both are taken to be in one frame");
  } else if (!reference->frame().known()) {
    c.notes.push_back("the reference does not name its frame: it is taken to be the survey's");
  }

  const Box box = survey->bounds(c.plane), reference_box = reference->bounds(c.plane);
  if (box.empty()) throw InputError(options.survey.string(), "", "covers no area");
  if (!meet(grown(box, options.registration.max_shift), reference_box))
    throw InputError(options.reference.string(), "",
                     "is elsewhere: " + boxText(reference_box) + " in the survey's frame, the survey " +
                         boxText(box) + "; check --reference-crs");
  c.survey_spacing = survey->spacing(c.plane);
  c.reference_spacing = reference->spacing(c.plane);
  c.cell = options.cell > 0 ? options.cell : std::max(c.survey_spacing, c.reference_spacing);
  const double fewest = std::sqrt((box.east - box.west) * (box.north - box.south) / kMostCellsOfMap);
  if (c.cell < fewest) {
    c.cell = fewest;
    c.notes.push_back("the cells were enlarged: the survey is large");
  }
  c.survey = survey->read(c.plane, box, c.cell);
  const double margin = (options.registration.horizontal ? options.registration.max_shift : 0.0) + 3 * c.cell;
  c.reference = reference->read(c.plane, grown(c.survey.box(), margin), c.cell);

  const double here = medianHeight(c.survey), there = medianHeight(c.reference);
  if (!std::isfinite(here))
    throw InputError(options.survey.string(), "",
                     "has no height in cells of " + decimals(c.cell, 3) + " m; give a smaller --cell");
  if (!std::isfinite(there))
    throw InputError(options.reference.string(), "", "has no height in the survey's area");
  c.reference_turned = options.reference_up == "down" ||
                       (options.reference_up != "up" && std::abs(here + there) < std::abs(here - there));
  if (c.reference_turned) turn(c.reference);

  c.registration = registerMaps(c.survey, c.reference, options.registration);
  if (c.registration.cells == 0)
    throw InputError(options.reference.string(), "",
                     "has fewer than 30 cells in common with the survey; give a smaller --cell");
  if (!c.registration.note.empty()) c.notes.push_back(c.registration.note);
  c.difference = differenceOf(c.survey, c.reference, c.registration.offset);
  return c;
}

}  // namespace fathom::compare
