#include "recon/viewer/view_server.hpp"

#include <httplib.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "realtime/kernel/input_error.hpp"
#include "recon/viewer/served_folder.hpp"

namespace fathom::viewer {
namespace {

using httplib::Request;
using httplib::Response;

constexpr int kForbidden = 403, kNotFound = 404, kBadRange = 416;
constexpr std::size_t kThreads = 8;      // a browser asks for six files at a time
constexpr std::size_t kPiece = 1 << 16;  // of a file read and sent at a time [bytes]

void refuse(Response& response, int status, const char* why) {
  response.status = status;
  response.set_content(std::string(why) + "\n", "text/plain");
}

// Browsers ask for whole blocks, the last of which ends behind the file's end. A range is to be cut there
// (RFC 9110, 14.1.2), which this httplib leaves to its user though it hands the request over as constant.
// Gives whether every range begins inside the file.
bool cutRanges(const Request& request, std::size_t size) {
  const auto end = static_cast<ssize_t>(size);
  auto& ranges = const_cast<Request&>(request).ranges;
  for (auto& [first, last] : ranges) {
    if (first >= end) {
      ranges.clear();  // they would be taken of the refusal's text
      return false;
    }
    if (first < 0) {  // the last so many bytes
      first = std::max<ssize_t>(end - last, 0);
      last = end - 1;
    }
    last = last < 0 ? end - 1 : std::min(last, end - 1);
  }
  return true;
}

// Sends a file, or the ranges of it that were asked for, piece by piece.
void sendFile(const std::filesystem::path& path, const Request& request, Response& response) {
  auto file = std::make_shared<std::ifstream>(path, std::ios::binary);
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  if (!*file || error) return refuse(response, kNotFound, "cannot be read");
  const std::string type(contentType(path));
  if (size == 0) return response.set_content("", type);
  if (!cutRanges(request, size)) return refuse(response, kBadRange, "The file ends before that.");
  response.set_content_provider(static_cast<std::size_t>(size), type,
                                [file](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                                  std::array<char, kPiece> piece;
                                  file->clear();
                                  file->seekg(static_cast<std::streamoff>(offset));
                                  file->read(piece.data(),
                                             static_cast<std::streamsize>(std::min(length, piece.size())));
                                  const auto got = static_cast<std::size_t>(file->gcount());
                                  return got > 0 && sink.write(piece.data(), got);
                                });
}

}  // namespace

ServedDive findDive(const std::filesystem::path& folder, const std::filesystem::path& page) {
  if (!std::filesystem::is_regular_file(page / "index.html"))
    throw InputError(page.string(), "",
                     "holds no index.html: build the target fathom_topside_page, or give --page");
  ServedDive dive{page, folder, {}};
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
    const auto images = std::filesystem::weakly_canonical(dive.output / name->get<std::string>(), error);
    if (!error && std::filesystem::is_directory(images, error)) dive.images = images;
  }
  return dive;
}

struct ViewServer::Impl {
  ServedDive dive;
  httplib::Server server;
  std::thread thread;
  int port = 0;

  void routes();
};

void ViewServer::Impl::routes() {
  server.set_pre_routing_handler([](const Request& request, Response& response) {
    response.set_header("X-Content-Type-Options", "nosniff");
    response.set_header("Referrer-Policy", "no-referrer");
    response.set_header("Cache-Control", "no-cache");
    if (namesThisMachine(request.get_header_value("Host")))
      return httplib::Server::HandlerResponse::Unhandled;
    refuse(response, kForbidden, "This server answers pages of this machine alone.");
    return httplib::Server::HandlerResponse::Handled;
  });
  const auto serve = [this](const char* pattern, const std::filesystem::path& root, const char* index) {
    server.Get(pattern, [root, index](const Request& request, Response& response) {
      const std::string name = request.matches[1];
      const auto file = root.empty() ? std::nullopt : fileInside(root, name.empty() ? index : name);
      if (!file) return refuse(response, kNotFound, "There is no such file.");
      sendFile(*file, request, response);
    });
  };
  server.Get("/view.json", [this](const Request&, Response& response) {
    const std::string name = std::filesystem::weakly_canonical(dive.output).string();
    const nlohmann::json view{{"dive", "dive/"}, {"images", "images/"}, {"name", name}};
    response.set_content(view.dump(), "application/json");
  });
  serve("/dive/(.*)", dive.output, "");
  serve("/images/(.*)", dive.images, "");
  serve("/(.*)", dive.page, "index.html");
}

ViewServer::ViewServer(ServedDive dive, int port) : impl_(std::make_unique<Impl>()) {
  impl_->dive = std::move(dive);
  impl_->server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  impl_->server.set_keep_alive_timeout(2);
  impl_->routes();
  constexpr const char* kAddress = "127.0.0.1";
  impl_->port = port == 0                                    ? impl_->server.bind_to_any_port(kAddress)
                : impl_->server.bind_to_port(kAddress, port) ? port
                                                             : -1;
  if (impl_->port <= 0)
    throw InputError("--port " + std::to_string(port), "", "cannot be had: another program listens there");
  impl_->thread = std::thread([this] { impl_->server.listen_after_bind(); });
}

ViewServer::~ViewServer() {
  // stop() only acts on a server that runs already.
  while (!impl_->server.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  impl_->server.stop();
  impl_->thread.join();
}

int ViewServer::port() const {
  return impl_->port;
}

}  // namespace fathom::viewer
