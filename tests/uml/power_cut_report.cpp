#include "tests/uml/power_cut_report.hpp"

#include <cstdio>
#include <random>

#include "tests/support/test_data.hpp"
#include "tests/uml/power_cut.hpp"

namespace fathom::uml {
namespace {

struct Options {
  int cuts = 10;
  unsigned seed = 1;
  bool kind_drive = false;
  PowerCutOptions cut;
};

int run(Options o) {
  std::mt19937 random(o.seed);
  std::uniform_real_distribution<double> instant(3.0, 9.0);  // [s] after the recorder began
  int bad = 0;
  std::int64_t worst_ms = 0;
  std::printf(
      "cut  after s  offered  durable  found  lost ms  images  without event  halves  log cut B  after "
      "restart\n");
  for (int i = 0; i < o.cuts; ++i) {
    const test::TemporaryFolder folder;
    o.cut.cut_after_s = instant(random);
    if (!o.kind_drive) o.cut.drive_seed = static_cast<unsigned>(random());
    const PowerCut cut = cutPower(o.cut, folder.path());
    if (cut.skipped) {
      std::printf("no user-mode Linux here: install the Debian package user-mode-linux\n");
      return 77;
    }
    if (!cut.began && cut.wrong.empty()) {
      std::printf("     after %.3f s nothing was recorded yet; again\n", cut.cut_after_s);
      --i;
      continue;
    }
    std::printf("%3d  %7.3f  %7llu  %7llu  %5llu  %7lld  %6llu  %13llu  %6llu  %9llu  %7llu\n", i + 1,
                cut.cut_after_s, static_cast<unsigned long long>(cut.offered),
                static_cast<unsigned long long>(cut.durable), static_cast<unsigned long long>(cut.found),
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
  std::printf("%d cuts, %d with something wrong; most lost: the last %lld ms\n", o.cuts, bad,
              static_cast<long long>(worst_ms));
  return bad == 0 ? 0 : 1;
}

}  // namespace

void powerCutReport(CommandLine& program) {
  static Options o;
  CommandLine& command =
      program.command("power-cut", "Cuts the power of a machine that records, and reads its disk back", "",
                      [] { return run(o); });
  command.shown("--cuts", o.cuts, "how many", 1, 10000);
  command.shown("--seed", o.seed, "of the instants, and of what the drive loses");
  command.shown("--width", o.cut.width, "of an image [px]");
  command.shown("--height", o.cut.height, "of an image [px]");
  command.add_flag("--kind-drive", o.kind_drive, "the drive keeps what was not flushed");
}

}  // namespace fathom::uml
