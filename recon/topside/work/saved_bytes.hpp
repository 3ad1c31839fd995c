#pragma once

#include <concepts>
#include <string>
#include <type_traits>

#include "realtime/base/bytes/state_archive.hpp"
#include "recon/geometry/state_values.hpp"
#include "recon/topside/work/stage_store.hpp"

// How values become blocks of a work file (state_archive.hpp).
namespace fathom::topside {

// For the exchangeState() of a type that is not the stage's own: const when writing.
template <typename T, typename U>
concept Is = std::same_as<std::remove_cvref_t<T>, U>;

// What `write` gives to a StateWriter, in a block as long as it needs.
template <typename Write>
[[nodiscard]] Bytes savedBytes(const Write& write) {
  rt::StateWriter measure{std::span<std::uint8_t>()};
  write(measure);
  Bytes bytes(measure.needed());
  rt::StateWriter writer(bytes);
  write(writer);
  return bytes;
}

template <typename T>
void saveBlock(WorkFileWriter& file, const std::string& block, const T& value) {
  file.add(block, savedBytes([&](rt::StateWriter& writer) { writer(value); }));
}

// Throws DamagedWork.
template <typename T>
[[nodiscard]] T loadBlock(const WorkFile& file, const std::string& block) {
  const Bytes bytes = file.read(block);
  rt::StateReader reader(bytes);
  T value;
  if (!reader(value) || reader.left() != 0) throw DamagedWork(file.path());
  return value;
}

}  // namespace fathom::topside
