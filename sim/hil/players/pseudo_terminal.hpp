#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

namespace fathom::sim {

// A serial cable to a program under test, which opens link() as its port; the bench writes and reads the
// other end. Raw in both directions. Bytes that the program leaves unread beyond kUnreadBytes are discarded
// and counted.
class PseudoTerminal {
 public:
  static constexpr std::size_t kUnreadBytes = 2048;

  // Creates the pair and a symbolic link to the program's end, which outlives restarts of the program. Throws
  // InputError for a link that cannot be created, std::system_error without pseudo-terminals.
  explicit PseudoTerminal(std::filesystem::path link);
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  // Never blocks; true when all bytes were accepted.
  bool write(std::span<const std::uint8_t> bytes) noexcept;
  // Reads what the program has written; never blocks.
  [[nodiscard]] std::size_t read(std::span<std::uint8_t> buffer) noexcept;
  [[nodiscard]] const std::filesystem::path& link() const { return link_; }
  [[nodiscard]] std::uint64_t unreadBytes() const { return unread_; }

 private:
  std::filesystem::path link_;
  int master_ = -1, slave_ = -1;  // the slave is kept open, so that the pair outlives the program
  std::uint64_t unread_ = 0;
};

}  // namespace fathom::sim
