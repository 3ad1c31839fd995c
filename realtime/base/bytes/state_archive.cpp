#include "realtime/base/bytes/state_archive.hpp"

#include <algorithm>

#include "realtime/base/bytes/crc32.hpp"

namespace fathom::rt {

std::size_t StateWriter::beginSection() noexcept {
  const StateSectionHead head;
  bytes(&head, sizeof head);
  return size_ - std::min(size_, sizeof head);
}

void StateWriter::endSection(std::size_t at, std::uint32_t tag, std::uint32_t version) noexcept {
  if (full_) return;
  StateSectionHead head;
  const std::span<const std::uint8_t> content = written().subspan(at + sizeof head);
  head.tag = tag;
  head.version = version;
  head.bytes = content.size();
  head.crc = crc32(content);
  std::memcpy(buffer_.data() + at, &head, sizeof head);
}

bool StateReader::sectionsAreWhole() const noexcept {
  std::size_t at = at_;
  while (ok() && at < end_) {
    StateSectionHead head;
    if (end_ - at < sizeof head) return false;
    std::memcpy(&head, bytes_.data() + at, sizeof head);
    at += sizeof head;
    if (head.bytes > end_ - at || crc32(bytes_.subspan(at, head.bytes)) != head.crc) return false;
    at += head.bytes;
  }
  return ok();
}

void StateReader::beginSection(std::uint32_t tag, std::uint32_t version) noexcept {
  StateSectionHead head;
  bytes(&head, sizeof head);
  if (!ok()) return;
  if (head.tag != tag) return fail("another part stands where one was expected");
  if (head.version != version) return fail("a part was written by another version of the program");
  if (head.bytes > left()) return fail("it ends early");
  if (crc32(bytes_.subspan(at_, head.bytes)) != head.crc) return fail("a checksum is wrong");
  end_ = at_ + head.bytes;
}

void StateReader::endSection() noexcept {
  if (ok() && left() > 0) fail("a part is longer than it should be");
  end_ = bytes_.size();
}

}  // namespace fathom::rt
