#include "recon/products/exports/survey_geopackage.hpp"

#include <set>
#include <vector>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/compare/plane_frame.hpp"
#include "recon/products/exports/results_files.hpp"
#include "recon/products/rasters/layer_picture.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

struct ProjectLayer {
  std::string id, title, xml;
  bool shown = false;
};

// A ramp from least to greatest; a layer with colours of its own needs none.
std::string rendererOf(const nlohmann::json& layer) {
  constexpr int kSteps = 16;
  const std::string ramp = layer.value("ramp", "");
  if (ramp.empty()) return "";
  const double low = layer.at("min").get<double>(), high = layer.at("max").get<double>();
  std::string items;
  for (int k = 0; k <= kSteps; ++k) {
    const double part = static_cast<double>(k) / kSteps, value = low + part * (high - low);
    const Rgb c = rampColour(ramp, part);
    items += formatted("<item value=\"%.9g\" label=\"%s\" color=\"#%02x%02x%02x\" alpha=\"255\"/>", value,
                       decimals(value, 2).c_str(), c[0], c[1], c[2]);
  }
  return formatted(
             "<pipe><rasterrenderer type=\"singlebandpseudocolor\" band=\"1\" opacity=\"1\" "
             "classificationMin=\"%.9g\" classificationMax=\"%.9g\"><rastershader><colorrampshader "
             "colorRampType=\"INTERPOLATED\" classificationMode=\"1\" clip=\"0\" minimumValue=\"%.9g\" "
             "maximumValue=\"%.9g\">",
             low, high, low, high) +
         items + "</colorrampshader></rastershader></rasterrenderer></pipe>";
}

// As QGIS writes it; `name`, as EPSG:32755, where it has one.
std::string systemOf(const compare::PlaneFrame& frame, const std::string& name) {
  return "<spatialrefsys><wkt>" + markupText(frame.wkt) + "</wkt><authid>" + markupText(name) +
         "</authid></spatialrefsys>";
}

// `srs`: of the results.
ProjectLayer rasterOf(const nlohmann::json& layer, const std::string& source, const std::string& srs) {
  const std::string name = layer.at("name").get<std::string>(), unit = layer.value("unit", "");
  ProjectLayer out{"raster_" + name,
                   layer.at("title").get<std::string>() + (unit.empty() ? "" : " [" + unit + "]"), "",
                   name == "orthomosaic" || name == "elevation"};
  out.xml = "<maplayer type=\"raster\"><id>" + markupText(out.id) + "</id><datasource>" + markupText(source) +
            "</datasource><layername>" + markupText(out.title) + "</layername><srs>" + srs +
            "</srs><provider>gdal</provider>" + rendererOf(layer) + "</maplayer>\n";
  return out;
}

// Lines and outlines in one colour; QGIS needs no more than a symbol of simple layers.
ProjectLayer vectorOf(const std::string& table, const char* geometry, const char* colour, double width,
                      bool shown, const std::string& srs) {
  ProjectLayer out{"vector_" + table, table, "", shown};
  const std::string symbol = formatted(
      "<symbol type=\"%s\" name=\"0\" alpha=\"1\"><layer class=\"SimpleLine\" enabled=\"1\"><Option "
      "type=\"Map\"><Option type=\"QString\" name=\"line_color\" value=\"%s\"/><Option type=\"QString\" "
      "name=\"line_width\" value=\"%.2f\"/></Option></layer></symbol>",
      std::string(geometry) == "Polygon" ? "fill" : "line", colour, width);
  out.xml = "<maplayer type=\"vector\" geometry=\"" + std::string(geometry) + "\"><id>" + out.id +
            "</id><datasource>./survey.gpkg|layername=" + table + "</datasource><layername>" + table +
            "</layername><srs>" + srs +
            "</srs><provider encoding=\"UTF-8\">ogr</provider><renderer-v2 type=\"singleSymbol\"><symbols>" +
            symbol + "</symbols></renderer-v2></maplayer>\n";
  return out;
}

std::vector<ProjectLayer> layersOf(const nlohmann::json& scene, const fs::path& from,
                                   const GeopackageCounts& counts, const std::string& raster_srs,
                                   const std::string& vector_srs) {
  std::vector<ProjectLayer> layers;
  layers.push_back(vectorOf("track", "Line", "240,185,94,255", 0.5, true, vector_srs));
  if (counts.contours > 0)
    layers.push_back(vectorOf("contours", "Line", "60,60,60,160", 0.2, true, vector_srs));
  if (counts.footprints > 0)
    layers.push_back(vectorOf("footprints", "Polygon", "80,140,160,255", 0.2, false, vector_srs));
  std::vector<ProjectLayer> others;
  for (const nlohmann::json& layer : scene.at("layers")) {
    ProjectLayer one =
        rasterOf(layer, (from / layer.at("file").get<std::string>()).generic_string(), raster_srs);
    // The orthomosaic over the elevation, both over what is not shown.
    if (one.id == "raster_orthomosaic")
      layers.insert(layers.end(), one);
    else
      others.push_back(std::move(one));
  }
  layers.insert(layers.end(), others.begin(), others.end());
  return layers;
}

}  // namespace

void writeQgisProject(const fs::path& folder, const fs::path& results, const std::string& crs,
                      double contours) {
  static const std::set<std::string> kOurs{"survey.qgs", "survey.qgs~", "survey.gpkg",
                                           "survey_attachments.zip"};
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (!kOurs.contains(entry.path().filename().string()))
      throw InputError(folder.string(), entry.path().filename().string(),
                       "is not of a project that was written before; give another folder");
  fs::create_directories(folder);
  const nlohmann::json scene = readResultJson(results / "scene.json");
  const GeopackageCounts counts = writeSurveyGeopackage(folder / "survey.gpkg", results, crs, contours);
  const std::string system = systemOf(frameNamed(crs), crs);
  std::vector<ProjectLayer> layers;
  std::string name;
  try {
    name = scene.at("name").get<std::string>();
    layers = layersOf(scene, fs::proximate(results, folder), counts, systemOf(frameOf(results), ""), system);
  } catch (const nlohmann::json::exception&) {
    throw InputError((results / "scene.json").string(), "layers", "are not as a run writes them");
  }
  std::string tree, maps;
  for (const ProjectLayer& layer : layers) {
    tree += "<layer-tree-layer id=\"" + markupText(layer.id) + "\" name=\"" + markupText(layer.title) +
            "\" checked=\"" + (layer.shown ? "Qt::Checked" : "Qt::Unchecked") + "\" expanded=\"0\"/>\n";
    maps += layer.xml;
  }
  writeFile(
      folder / "survey.qgs",
      "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n<qgis version=\"3.22.0\" projectname=\"" +
          markupText(name) + "\">\n<title>" + markupText(name) + "</title>\n<projectCrs>" + system +
          "</projectCrs>\n<layer-tree-group>\n" + tree + "</layer-tree-group>\n<projectlayers>\n" + maps +
          "</projectlayers>\n<properties><SpatialRefSys><ProjectionsEnabled "
          "type=\"int\">1</ProjectionsEnabled></SpatialRefSys><Paths><Absolute "
          "type=\"bool\">false</Absolute></Paths></properties>\n</qgis>\n");
}

}  // namespace fathom::topside
