#include <csignal>
#include <cstdio>
#include <memory>

#include "recon/topside/commands/commands.hpp"
#include "recon/topside/viewer/dive_server.hpp"

namespace fathom::topside {
namespace {

constexpr int kDefaultPort = 8090;

struct ViewOptions {
  std::filesystem::path folder, page;
  int port = kDefaultPort;
};

int runView(const ViewOptions& options) {
  // Blocked before the server's threads begin, so that the signal comes here.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  const ServedDive dive = findDive(options.folder);
  const web::PageServer server = serveDive(dive, web::pageFolder(options.page, "topside"), options.port);
  if (!dive.hasImages())
    std::fprintf(stderr, "%s: the original images are not there: the model is shown without them\n",
                 dive.images.empty() ? dive.output.c_str() : dive.images.c_str());
  std::printf("http://127.0.0.1:%d/ (Ctrl-C ends it)\n", server.port());
  std::fflush(stdout);
  int signal = 0;
  sigwait(&signals, &signal);
  return kExitSuccess;
}

}  // namespace

void addViewCommand(CommandLine& app) {
  auto options = std::make_shared<ViewOptions>();
  CommandLine& command =
      app.command("view", "open a dive's output in the browser",
                  "Example: fathom-topside view missions/reef-grid", [options] { return runView(*options); });
  command.add_option("folder", options->folder, "output folder, or the mission folder around it")->required();
  command.add_option("--http,--port", options->port, "port on 127.0.0.1; 0: any that is free (8090)")
      ->check(CLI::Range(0, 65535));
  command.add_option("--page", options->page,
                     "folder of the page (default: ../share/fathom/topside from the program)");
}

}  // namespace fathom::topside
