#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "realtime/base/config_keys.hpp"
#include "realtime/base/files/atomic_file.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::test {

// Rows of a page for the keys that begin with one of `prefixes`, a text such as "link. map.".
inline std::string keyTable(const ConfigListing& listing, const std::string& prefixes) {
  std::string table = "| key | unit | range | default | meaning |\n| --- | --- | --- | --- | --- |\n";
  for (const ConfigListing::Row& row : listing.rows()) {
    std::istringstream words(prefixes);
    for (std::string prefix; words >> prefix;)
      if (row.key.starts_with(prefix))
        table += "| `" + row.key + "` | " + row.unit + " | " + row.range + " | `" + row.value + "` | " +
                 row.meaning + " |\n";
  }
  return table;
}

// Holds every page below `root` to the tables of keys that it has between "<!-- keys of PROGRAM: PREFIXES
// -->" and "<!-- end of keys -->": they are those of the program. Writes them instead where
// FATHOM_WRITE_PAGES is set.
inline void expectPagesHoldKeys(const std::filesystem::path& root, const std::string& program,
                                const ConfigListing& listing) {
  const std::string begin = "<!-- keys of " + program + ": ", close = " -->\n", end = "<!-- end of keys -->";
  int found = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
    if (entry.path().filename() != "README.md") continue;
    std::string page = readText(entry.path());
    for (std::size_t at = page.find(begin); at != std::string::npos; at = page.find(begin, at + 1)) {
      ++found;
      const std::size_t prefixes = at + begin.size(), first = page.find(close, at) + close.size(),
                        last = page.find(end, at);
      ASSERT_NE(last, std::string::npos) << entry.path() << ": no " << end;
      const std::string wanted = keyTable(listing, page.substr(prefixes, first - close.size() - prefixes));
      if (std::getenv("FATHOM_WRITE_PAGES") != nullptr)
        writeFile(entry.path(), page.replace(first, last - first, wanted));
      else
        EXPECT_EQ(page.substr(first, last - first), wanted)
            << entry.path() << ": FATHOM_WRITE_PAGES=1 writes the tables of keys";
    }
  }
  EXPECT_GT(found, 0) << "no page has a table of keys of " << program;
}

}  // namespace fathom::test
