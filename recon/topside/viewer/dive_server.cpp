#include "recon/topside/viewer/dive_server.hpp"

#include <httplib.h>

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
    web::serveFolder(server, "/dive/", dive.output);
    if (dive.hasImages()) web::serveFolder(server, "/images/", dive.images);
  });
}

}  // namespace fathom::topside
