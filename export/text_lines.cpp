// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/text_lines.hpp"

#include <vector>

#include <tbb/parallel_for.h>

namespace maquette::exporting {
namespace {

constexpr std::size_t kPiece = 4096;  ///< items that one task formats: some 0.2 MB
constexpr std::size_t kAtOnce = 8;    ///< pieces in memory

}  // namespace

bool write_pieces(AtomicFile& file, std::size_t count,
                  const std::function<void(fmt::memory_buffer&, std::size_t, std::size_t)>& append,
                  const RunContext& run, double from, double to) {
  std::vector<fmt::memory_buffer> pieces(kAtOnce);
  for (std::size_t start = 0; start < count; start += kPiece * kAtOnce) {
    if (run.stopped()) return false;
    const std::size_t batch = std::min(kAtOnce, (count - start + kPiece - 1) / kPiece);
    tbb::parallel_for(std::size_t{0}, batch, [&](std::size_t k) {
      const std::size_t first = start + k * kPiece;
      pieces[k].clear();
      append(pieces[k], first, std::min(count, first + kPiece));
    });
    for (std::size_t k = 0; k < batch; ++k) file.write(pieces[k].data(), pieces[k].size());
    const std::size_t done = std::min(count, start + batch * kPiece);
    run.progress(from + (to - from) * static_cast<double>(done) / static_cast<double>(count));
  }
  return !run.stopped();
}

}  // namespace maquette::exporting
