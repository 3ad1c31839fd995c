#pragma once

#include <filesystem>
#include <memory>
#include <string>

namespace fathom::viewer {

// What is served: `/` the page, `/dive/` an output folder, `/images/` the folder of the original images, and
// `/view.json`, which tells the page so.
struct ServedDive {
  std::filesystem::path page;    // holds index.html
  std::filesystem::path output;  // holds scene.json
  std::filesystem::path images;  // empty: none
};

// Finds the parts from what the user gave: an output folder, or the mission folder that holds one in
// topside/. The image folder is the one that scene.json names. Throws InputError where there is no
// scene.json, it is none, or the page is absent.
[[nodiscard]] ServedDive findDive(const std::filesystem::path& folder, const std::filesystem::path& page);

// Serves a dive to browsers on this machine (127.0.0.1 alone), whole files and ranges of them; nothing can be
// changed through it. Runs from construction to destruction. Throws InputError where the port cannot be had.
class ViewServer {
 public:
  ViewServer(ServedDive dive, int port);  // port 0: any that is free
  ~ViewServer();
  ViewServer(const ViewServer&) = delete;
  ViewServer& operator=(const ViewServer&) = delete;
  [[nodiscard]] int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::viewer
