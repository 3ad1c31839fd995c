#include "recon/topside/viewer/dive_server.hpp"

#include <ogr_spatialref.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "realtime/base/input_error.hpp"
#include "telemetry/web/page_server.hpp"

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

// Three's decoders of tiles: WebAssembly in workers that the page makes.
constexpr const char* kDecoders = " blob: 'wasm-unsafe-eval'";

// A projected coordinate reference system in proj4's words; "" for what is no code of four to six digits, a
// code that PROJ does not know, or one that is in no metres, which the page's measures are.
std::string projectionOf(const std::string& epsg) {
  constexpr std::size_t kLeastDigits = 4, kMostDigits = 6;
  if (epsg.size() < kLeastDigits || epsg.size() > kMostDigits ||
      epsg.find_first_not_of("0123456789") != std::string::npos)
    return {};
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
  config.option = "--http";
  config.page = page;
  config.more_scripts = kDecoders;
  nlohmann::json view{{"dive", "dive/"},
                      {"images", nullptr},
                      {"name", std::filesystem::weakly_canonical(dive.output).string()}};
  if (dive.hasImages()) view["images"] = "images/";
  web::Routes routes;
  routes.get("/view.json",
             [text = view.dump()](const web::HttpRequest&) { return web::answer(text, "application/json"); });
  routes.getBelow("/crs/", [](const web::HttpRequest& request) {
    const std::string definition = projectionOf(request.below);
    return definition.empty() ? web::refusal(web::status::kNotFound, "There is no such projection in metres.")
                              : web::answer(definition, "text/plain");
  });
  routes.getBelow("/dive/", [folder = dive.output](const web::HttpRequest& request) {
    return web::dataResponse(web::fileInside(folder, request.below), request);
  });
  if (dive.hasImages())
    routes.getBelow("/images/", [folder = dive.images](const web::HttpRequest& request) {
      auto file = web::fileInside(folder, request.below);
      if (file && !web::isPicture(*file)) file.reset();
      return web::dataResponse(file, request);
    });
  return web::PageServer(config, std::move(routes));
}

}  // namespace fathom::topside
