#include "recon/compare/compare.hpp"

#include <gdal_priv.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/numbers/portable_math.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/compare/surface_file.hpp"

namespace fathom::compare {
namespace {

constexpr std::array<double, 6> kSlopes = {0, 5, 15, 30, 45, 90};  // [deg]
constexpr std::size_t kSigmaClasses = 4;

double slopeDegrees(const HeightMap& map, double east, double north) {
  const double c = map.cell;
  const double de = (map.at(east + c, north) - map.at(east - c, north)) / (2 * c);
  const double dn = (map.at(east, north + c) - map.at(east, north - c)) / (2 * c);
  return radiansToDegrees(std::atan(hypotenuse(de, dn)));
}

struct Compared {
  double difference, slope, sigma;
};

std::vector<DifferenceClass> bySlope(const std::vector<Compared>& all) {
  std::vector<DifferenceClass> classes;
  for (std::size_t k = 0; k + 1 < kSlopes.size(); ++k) {
    std::vector<double> in;
    for (const Compared& c : all)
      if (c.slope >= kSlopes[k] && c.slope < kSlopes[k + 1]) in.push_back(c.difference);
    if (!in.empty()) classes.push_back({kSlopes[k], kSlopes[k + 1], statisticsOf(std::move(in)), 0});
  }
  return classes;
}

// Quarters of the cells by rising uncertainty.
std::vector<DifferenceClass> bySigma(std::vector<Compared> all) {
  all.erase(std::remove_if(all.begin(), all.end(), [](const Compared& c) { return !(c.sigma > 0); }),
            all.end());
  std::sort(all.begin(), all.end(), [](const Compared& a, const Compared& b) { return a.sigma < b.sigma; });
  std::vector<DifferenceClass> classes;
  if (all.size() < kSigmaClasses) return classes;
  for (std::size_t k = 0; k < kSigmaClasses; ++k) {
    const std::size_t begin = k * all.size() / kSigmaClasses, end = (k + 1) * all.size() / kSigmaClasses;
    std::vector<double> in;
    double ratios = 0;
    for (std::size_t i = begin; i < end; ++i) {
      in.push_back(all[i].difference);
      ratios += std::pow(all[i].difference / all[i].sigma, 2);
    }
    classes.push_back({all[begin].sigma, all[end - 1].sigma, statisticsOf(std::move(in)),
                       std::sqrt(ratios / static_cast<double>(end - begin))});
  }
  return classes;
}

constexpr int kLongSide = 1100, kLegend = 150, kMargin = 16;  // [px]
const cv::Scalar kInk(51, 39, 27);                            // BGR

// -1 blue, 0 white, +1 red.
cv::Vec3b diverging(double value) {
  const double v = std::clamp(value, -1.0, 1.0), pale = 1 - std::abs(v);
  const auto mix = [&](double full) {
    return static_cast<std::uint8_t>(std::lround(full + (250 - full) * pale));
  };
  return v >= 0 ? cv::Vec3b(mix(43), mix(24), mix(178)) : cv::Vec3b(mix(172), mix(102), mix(33));
}

cv::Vec3b viridis(double part) {
  static const cv::Mat table = [] {
    cv::Mat grey(1, 256, CV_8U), colours;
    for (int i = 0; i < 256; ++i) grey.at<std::uint8_t>(i) = static_cast<std::uint8_t>(i);
    cv::applyColorMap(grey, colours, cv::COLORMAP_VIRIDIS);
    return colours;
  }();
  return table.at<cv::Vec3b>(static_cast<int>(std::lround(255 * std::clamp(part, 0.0, 1.0))));
}

// 1, 2 or 5 times a power of ten, about a fifth of the width.
double barLength(double metres) {
  const double wanted = metres / 5, power = std::pow(10, std::floor(std::log10(wanted)));
  for (const double step : {5.0, 2.0, 1.0})
    if (step * power <= wanted) return step * power;
  return power;
}

std::string heightText(double metres, double range) {
  const int digits = range < 0.1 ? 4 : range < 1 ? 3 : range < 10 ? 2 : 1;
  return formatted("%+.*f m", digits, metres);
}

using Colour = std::function<cv::Vec3b(int column, int row)>;

void draw(const HeightMap& map, const Colour& colour, const std::function<cv::Vec3b(double)>& ramp,
          double low, double high, const std::filesystem::path& png) {
  const double zoom = static_cast<double>(kLongSide) / std::max(map.columns, map.rows);
  const int width = std::max(1, static_cast<int>(map.columns * zoom)),
            height = std::max(1, static_cast<int>(map.rows * zoom));
  constexpr int kFoot = 40;
  cv::Mat page(std::max(height, 260) + 2 * kMargin + kFoot, width + 2 * kMargin + kLegend, CV_8UC3,
               cv::Scalar(255, 255, 255));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int column = std::min(map.columns - 1, static_cast<int>(x / zoom));
      const int row = std::min(map.rows - 1, static_cast<int>(y / zoom));
      page.at<cv::Vec3b>(y + kMargin, x + kMargin) =
          std::isfinite(map.up[map.index(column, row)]) ? colour(column, row) : cv::Vec3b(228, 228, 228);
    }
  }
  const int left = width + 2 * kMargin, top = kMargin + 10, tall = 220;
  for (int y = 0; y < tall; ++y)
    page(cv::Rect(left, top + y, 22, 1)) = cv::Scalar(ramp(high - (high - low) * (y + 0.5) / tall));
  for (int k = 0; k <= 4; ++k) {
    const double value = high - (high - low) * k / 4;
    cv::putText(page, heightText(value, high - low), {left + 28, top + tall * k / 4 + 5},
                cv::FONT_HERSHEY_SIMPLEX, 0.42, kInk, 1, cv::LINE_AA);
  }
  const double bar = barLength(map.columns * map.cell);
  const int bar_px = static_cast<int>(bar / map.cell * zoom), foot = page.rows - kMargin;
  cv::rectangle(page, cv::Rect(kMargin, foot - 4, bar_px, 4), kInk, cv::FILLED);
  cv::putText(page, formatted("%g m, north up", bar), {kMargin + bar_px + 8, foot}, cv::FONT_HERSHEY_SIMPLEX,
              0.45, kInk, 1, cv::LINE_AA);
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", page, bytes))
    throw std::runtime_error("a picture cannot be encoded: " + png.string());
  writeFile(png, bytes);
}

}  // namespace

DifferenceStatistics statisticsOf(std::vector<double> d) {
  DifferenceStatistics s;
  s.cells = d.size();
  if (d.empty()) return s;
  const double n = static_cast<double>(d.size());
  double squares = 0;
  for (const double v : d) {
    s.bias += v / n;
    squares += v * v / n;
  }
  s.rms = std::sqrt(squares);
  s.deviation = std::sqrt(std::max(0.0, squares - s.bias * s.bias));
  std::sort(d.begin(), d.end());
  s.median = quantile(d, 0.5);
  s.p1 = quantile(d, 0.01);
  s.p5 = quantile(d, 0.05);
  s.p25 = quantile(d, 0.25);
  s.p75 = quantile(d, 0.75);
  s.p95 = quantile(d, 0.95);
  s.p99 = quantile(d, 0.99);
  std::vector<double> magnitudes;
  for (const double v : d) magnitudes.push_back(std::abs(v));
  std::sort(magnitudes.begin(), magnitudes.end());
  s.abs_p50 = quantile(magnitudes, 0.5);
  s.abs_p95 = quantile(magnitudes, 0.95);
  for (double& v : d) v = std::abs(v - s.median);
  std::sort(d.begin(), d.end());
  s.mad = kMadToSigma * quantile(d, 0.5);
  return s;
}

Difference differenceOf(const HeightMap& survey, const HeightMap& reference,
                        const RegistrationOffset& offset) {
  Difference out;
  out.map = survey;
  out.map.sigma.clear();
  out.map.west += offset.shift.x();
  out.map.north += offset.shift.y();
  std::vector<double> before;
  std::vector<Compared> after;
  std::size_t known = 0;
  for (int row = 0; row < survey.rows; ++row) {
    for (int column = 0; column < survey.columns; ++column) {
      const std::size_t at = survey.index(column, row);
      float& shown = out.map.up[at];
      const double up = static_cast<double>(survey.up[at]);
      if (!std::isfinite(up)) continue;
      ++known;
      const double east = survey.eastOf(column), north = survey.northOf(row);
      const double there = reference.at(east, north);
      if (std::isfinite(there)) before.push_back(up - there);
      const double e = east + offset.shift.x(), n = north + offset.shift.y();
      const double difference = up + offset.upAt(east, north) - reference.at(e, n);
      shown = static_cast<float>(difference);
      if (!std::isfinite(difference)) continue;
      after.push_back({difference, slopeDegrees(reference, e, n),
                       survey.sigma.empty() ? 0.0 : static_cast<double>(survey.sigma[at])});
    }
  }
  out.before = statisticsOf(std::move(before));
  std::vector<double> differences;
  for (const Compared& c : after) differences.push_back(c.difference);
  out.after = statisticsOf(std::move(differences));
  out.by_slope = bySlope(after);
  out.by_sigma = bySigma(after);
  out.overlap_m2 = static_cast<double>(out.after.cells) * survey.cell * survey.cell;
  out.survey_m2 = static_cast<double>(known) * survey.cell * survey.cell;
  return out;
}

void drawDifference(const HeightMap& difference, double limit, const std::filesystem::path& png) {
  draw(
      difference,
      [&](int column, int row) {
        return diverging(static_cast<double>(difference.up[difference.index(column, row)]) / limit);
      },
      [&](double value) { return diverging(value / limit); }, -limit, limit, png);
}

void drawHeights(const HeightMap& map, double low, double high, const std::filesystem::path& png) {
  const auto shade = [&](int column, int row) {
    const auto height = [&](int x, int y) {
      return static_cast<double>(
          map.up[map.index(std::clamp(x, 0, map.columns - 1), std::clamp(y, 0, map.rows - 1))]);
    };
    const double east = (height(column + 1, row) - height(column - 1, row)) / (2 * map.cell);
    const double north = (height(column, row - 1) - height(column, row + 1)) / (2 * map.cell);
    if (!std::isfinite(east) || !std::isfinite(north)) return 1.0;
    // Light from the north-west, 45 degrees up.
    const double lit = (0.5 * east - 0.5 * north + 0.7071) / std::sqrt(1 + east * east + north * north);
    return std::clamp(0.35 + 0.92 * lit, 0.2, 1.15);
  };
  const auto ramp = [&](double value) { return viridis((value - low) / std::max(high - low, 1e-9)); };
  draw(
      map,
      [&](int column, int row) {
        const cv::Vec3b flat = ramp(static_cast<double>(map.up[map.index(column, row)]));
        const double light = shade(column, row);
        cv::Vec3b out;
        for (int c = 0; c < 3; ++c) out[c] = cv::saturate_cast<std::uint8_t>(flat[c] * light);
        return out;
      },
      ramp, low, high, png);
}

void writeGeoTiff(const HeightMap& map, const PlaneFrame& frame, const std::filesystem::path& tif) {
  GDALAllRegister();
  GDALDriver* memory = GetGDALDriverManager()->GetDriverByName("MEM");
  GDALDriver* cog = GetGDALDriverManager()->GetDriverByName("COG");
  if (memory == nullptr || cog == nullptr) throw std::runtime_error("GDAL has no COG driver");
  const auto close = [](GDALDataset* d) { GDALClose(d); };
  const std::unique_ptr<GDALDataset, decltype(close)> raster(
      memory->Create("", map.columns, map.rows, 1, GDT_Float32, nullptr), close);
  if (!raster) throw std::runtime_error("no memory for a raster");
  double transform[6] = {map.west, map.cell, 0, map.north, 0, -map.cell};
  raster->SetGeoTransform(transform);
  if (frame.known()) raster->SetProjection(frame.wkt.c_str());
  GDALRasterBand* band = raster->GetRasterBand(1);
  band->SetNoDataValue(std::nan(""));
  band->SetDescription("survey less reference [m]");
  std::vector<float> values = map.up;
  char* options[] = {const_cast<char*>("COMPRESS=DEFLATE"), const_cast<char*>("PREDICTOR=YES"), nullptr};
  const std::unique_ptr<GDALDataset, decltype(close)> written(
      band->RasterIO(GF_Write, 0, 0, map.columns, map.rows, values.data(), map.columns, map.rows, GDT_Float32,
                     0, 0, nullptr) == CE_None
          ? cog->CreateCopy(tif.c_str(), raster.get(), FALSE, options, nullptr, nullptr)
          : nullptr,
      close);
  if (!written) throw std::runtime_error(tif.string() + " cannot be written: " + CPLGetLastErrorMsg());
}

namespace {

constexpr double kMostCellsOfMap = 16e6;  // of the survey's map; coarser beyond

// A frame in metres for a survey that is stored in degrees.
PlaneFrame metricFrame(const SurfaceFile& survey) {
  PlaneFrame own = survey.frame();
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
