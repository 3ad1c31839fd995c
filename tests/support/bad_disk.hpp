#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <new>
#include <vector>

#include "realtime/base/units.hpp"
#include "tests/support/bad_disk_control.hpp"
#include "tests/support/mapped_file.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {

// A disk under one folder that does what the test says while the program under test runs: in a child process
// that is started with environment(), and in this one when it links fathom_bad_disk_here. Everything is well
// until set(), and again after clear().
class BadDisk {
 public:
  struct Order {
    DiskFault fault = DiskFault::kNone;
    std::string path = "";    // a part of the file's path, as "sensors.lcmlog" or "img/"; "" for every file
    std::uint32_t calls = 0;  // DiskCall; 0: those that the fault usually has
    std::uint64_t after = 0;  // so many calls still go well
    std::uint64_t times = 0;  // then so many do not; 0: all
    std::int64_t for_ms = 0;  // it ends by itself so long after it was set; 0: it does not
    std::uint32_t stall_ms = 0;  // of DiskFault::kStall, each call
  };

  explicit BadDisk(const std::filesystem::path& folder) : file_(own_.path() / "bad-disk"), control_(file_) {
    const std::string path = std::filesystem::absolute(folder).lexically_normal().string();
    std::strncpy(control_->folder, path.c_str(), sizeof control_->folder - 1);
    use(true);
  }
  ~BadDisk() { use(false); }
  BadDisk(const BadDisk&) = delete;
  BadDisk& operator=(const BadDisk&) = delete;

  // Whether this process, where it links fathom_bad_disk_here, has that disk; a child that is forked later,
  // as this one.
  void use(bool here) {
    if (fathomBadDiskUse != nullptr) fathomBadDiskUse(here ? &*control_ : nullptr);
  }
  // From now on; gives the number of the rule. Rules are looked at in their order, the first that fits acts.
  std::size_t set(const Order& order) {
    std::size_t at = 0;
    while (at < BadDiskControl::kRules && control_->rules[at].fault != DiskFault::kNone) ++at;
    if (at == BadDiskControl::kRules) throw std::bad_alloc();
    BadDiskRule& rule = control_->rules[at];
    std::memset(rule.path, 0, sizeof rule.path);
    std::strncpy(rule.path, order.path.c_str(), sizeof rule.path - 1);
    rule.calls = order.calls;
    rule.after = order.after;
    rule.times = order.times;
    rule.stall_ms = order.stall_ms;
    rule.until_ns = order.for_ms == 0 ? 0 : nowNs() + order.for_ms * kMillisecond_ns;
    rule.seen = rule.hit = 0;
    rule.fault = order.fault;
    return at;
  }
  void clear() {
    for (BadDiskRule& rule : control_->rules) rule.fault = DiskFault::kNone;
  }
  // How many calls a rule has spoilt since it was set.
  [[nodiscard]] std::uint64_t hits(std::size_t rule) const { return control_->rules[rule].hit; }

  // For a child process, NAME=value.
  [[nodiscard]] std::vector<std::string> environment() const {
    // AddressSanitizer wants to be the first library of a program; here it need not be.
    const char* asan = std::getenv("ASAN_OPTIONS");
    return {"FATHOM_BAD_DISK=" + file_.string(), "LD_PRELOAD=" FATHOM_BIN_DIR "/libfathom_bad_disk.so",
            std::string("ASAN_OPTIONS=verify_asan_link_order=0") + (asan ? ":" + std::string(asan) : "")};
  }

 private:
  TemporaryFolder own_;
  std::filesystem::path file_;
  MappedFile<BadDiskControl> control_;
};

}  // namespace fathom::test
