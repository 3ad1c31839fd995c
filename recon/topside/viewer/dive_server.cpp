#include "recon/topside/viewer/dive_server.hpp"

#include <httplib.h>
#include <ogr_spatialref.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "realtime/kernel/input_error.hpp"

namespace fathom::topside {

bool ServedDive::hasImages() const {
  std::error_code error;
  return !images.empty() && std::filesystem::is_directory(images, error);
}

ServedDive findDive(const std::filesystem::path& folder) {
  ServedDive dive{folder, {}};
  if (!std::filesystem::is_regular_file(folder / "scene.json")) dive.output = folder / "topside";
  const std::filesystem::path file = dive.output / "scene.json";
  std::ifstream in(file);
  if (!std::filesystem::is_regular_file(file) || !in)
    throw InputError(
        folder.string(), "",
        "holds no scene.json: give an output folder of fathom-topside run, or its mission folder");
  const nlohmann::json scene = nlohmann::json::parse(in, nullptr, false);
  if (!scene.is_object()) throw InputError(file.string(), "", "is no JSON object: run fathom-topside again");
  if (const auto name = scene.find("image_folder"); name != scene.end() && name->is_string()) {
    std::error_code error;
    dive.images = std::filesystem::weakly_canonical(dive.output / name->get<std::string>(), error);
  }
  return dive;
}

namespace {

// A projected coordinate reference system in proj4's words; "" for a code that PROJ does not know, or one
// that is in no metres, which the page's measures are.
std::string projectionOf(const std::string& epsg) {
  OGRSpatialReference srs;
  CPLPushErrorHandler(CPLQuietErrorHandler);
  char* text = nullptr;
  std::string out;
  if (srs.importFromEPSG(std::stoi(epsg)) == OGRERR_NONE && srs.IsProjected() &&
      srs.exportToProj4(&text) == OGRERR_NONE && text != nullptr)
    out = text;
  CPLFree(text);
  CPLPopErrorHandler();
  return out;
}

}  // namespace

web::PageServer serveDive(const ServedDive& dive, const std::filesystem::path& page, int port) {
  web::PageServerConfig config;
  config.port = port;
  config.option = "--port";
  config.page = page;
  return web::PageServer(config, [&](httplib::Server& server) {
    nlohmann::json view{{"dive", "dive/"},
                        {"images", nullptr},
                        {"name", std::filesystem::weakly_canonical(dive.output).string()}};
    if (dive.hasImages()) view["images"] = "images/";
    server.Get("/view.json", [text = view.dump()](const httplib::Request&, httplib::Response& response) {
      response.set_content(text, "application/json");
    });
    server.Get(R"(/crs/(\d{4,6}))", [](const httplib::Request& request, httplib::Response& response) {
      const std::string definition = projectionOf(request.matches[1]);
      if (definition.empty())
        response.status = 404;
      else
        response.set_content(definition, "text/plain");
    });
    web::serveFolder(server, "/dive/", dive.output);
    if (dive.hasImages()) web::serveFolder(server, "/images/", dive.images);
  });
}

}  // namespace fathom::topside
