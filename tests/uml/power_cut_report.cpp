// Cuts the power of a recording machine at random instants; a table of what each cut cost.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <random>

#include "tests/support/test_data.hpp"
#include "tests/uml/power_cut.hpp"

int main(int argc, char** argv) {
  CLI::App app("cuts the power of a machine that records, and reads its disk back");
  int cuts = 10;
  unsigned seed = 1;
  bool kind_drive = false;
  fathom::uml::PowerCutOptions options;
  app.add_option("--cuts", cuts, "how many")->check(CLI::Range(1, 10000));
  app.add_option("--seed", seed, "of the instants, and of what the drive loses");
  app.add_option("--width", options.width, "of an image [px]");
  app.add_option("--height", options.height, "of an image [px]");
  app.add_flag("--kind-drive", kind_drive, "the drive keeps what was not flushed");
  CLI11_PARSE(app, argc, argv);

  std::mt19937 random(seed);
  std::uniform_real_distribution<double> instant(3.0, 9.0);  // [s] after the recorder began
  int bad = 0;
  std::int64_t worst_ms = 0;
  std::printf(
      "cut  after s  offered  told safe  found  lost ms  images  without event  halves  log cut B  went "
      "on\n");
  for (int i = 0; i < cuts; ++i) {
    const fathom::test::TemporaryFolder folder;
    options.cut_after_s = instant(random);
    if (!kind_drive) options.drive_seed = static_cast<unsigned>(random());
    const fathom::uml::PowerCut cut = fathom::uml::cutPower(options, folder.path());
    if (cut.skipped) {
      std::printf("no user-mode Linux here: install the Debian package user-mode-linux\n");
      return 77;
    }
    if (!cut.began && cut.wrong.empty()) {
      std::printf("     after %.3f s nothing was recorded yet; again\n", cut.cut_after_s);
      --i;
      continue;
    }
    std::printf("%3d  %7.3f  %7llu  %9llu  %5llu  %7lld  %6llu  %13llu  %6llu  %9llu  %7llu\n", i + 1,
                cut.cut_after_s, static_cast<unsigned long long>(cut.offered),
                static_cast<unsigned long long>(cut.told_safe), static_cast<unsigned long long>(cut.found),
                static_cast<long long>(cut.lost_ms), static_cast<unsigned long long>(cut.images),
                static_cast<unsigned long long>(cut.images_without_event),
                static_cast<unsigned long long>(cut.halves),
                static_cast<unsigned long long>(cut.log_bytes_cut),
                static_cast<unsigned long long>(cut.after_restart));
    for (const std::string& wrong : cut.wrong) std::printf("     WRONG: %s\n", wrong.c_str());
    std::fflush(stdout);
    bad += cut.wrong.empty() ? 0 : 1;
    worst_ms = std::max(worst_ms, cut.lost_ms);
  }
  std::printf("%d cuts, %d with something wrong; most lost: the last %lld ms\n", cuts, bad,
              static_cast<long long>(worst_ms));
  return bad == 0 ? 0 : 1;
}
