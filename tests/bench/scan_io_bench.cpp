// SPDX-License-Identifier: GPL-3.0-or-later

// Points per second and memory of every cloud format, beside reading and writing the same
// number of bytes without looking at them.
//
//   scan_io_bench [--benchmark_filter=E57]
//   MAQUETTE_BENCH_POINTS  points per file (2 M; 200 M shows that memory stays)
//   TMPDIR                 where the files go; the largest takes 75 bytes per point
//
// The counter peak_MiB is the most that the process has held so far (packed PCD is held as a
// whole, so it comes last).

#include <cstdlib>
#include <fstream>

#include <benchmark/benchmark.h>

#include "support/bench_times.hpp"
#include "support/matchers.hpp"
#include "support/streamed_cloud.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;

std::uint64_t point_count() {
  const char* text = std::getenv("MAQUETTE_BENCH_POINTS");
  return text != nullptr ? std::strtoull(text, nullptr, 10) : 2'000'000;
}

struct Format {
  const char* name;
  const char* file;
  CloudWriteOptions options;
};

CloudFields bench_fields() {
  CloudFields f;
  f.intensity = f.colour = true;
  return f;
}

/// The same batch again and again: what the values are makes no difference to the work.
Result<void> write_points(const std::filesystem::path& path, const CloudWriteOptions& options) {
  static const PointBatch batch = sample_points(bench_fields(), 256, 256, 1);
  MAQUETTE_TRY(const auto writer, create_cloud(path, options));
  MAQUETTE_TRY_VOID(writer->begin_station(sample_station(bench_fields(), 0, 0, 1)));
  for (std::uint64_t left = point_count(); left > 0;) {
    if (left >= batch.size()) {
      MAQUETTE_TRY_VOID(writer->write(batch));
      left -= batch.size();
    } else {
      MAQUETTE_TRY_VOID(writer->write(slice(batch, 0, static_cast<std::size_t>(left))));
      left = 0;
    }
  }
  return writer->finish();
}

void finish(benchmark::State& state, const std::filesystem::path& path) {
  const auto points = static_cast<double>(point_count());
  state.counters["points/s"] =
      benchmark::Counter(points, benchmark::Counter::kIsIterationInvariantRate);
  state.counters["bytes/point"] = static_cast<double>(std::filesystem::file_size(path)) / points;
  state.counters["peak_MiB"] = peak_mib();
}

void write_format(benchmark::State& state, const Format& format) {
  const ScratchFolder folder;
  for (auto _ : state)
    if (const auto done = write_points(folder / format.file, format.options); !done)
      return state.SkipWithError(done.error().message.c_str());
  finish(state, folder / format.file);
}

void read_format(benchmark::State& state, const Format& format) {
  const ScratchFolder folder;
  if (const auto done = write_points(folder / format.file, format.options); !done)
    return state.SkipWithError(done.error().message.c_str());
  for (auto _ : state) {
    const auto reader = open_cloud(folder / format.file);
    if (!reader) return state.SkipWithError(reader.error().message.c_str());
    PointBatch batch;
    std::uint64_t points = 0;
    while (true) {
      const auto more = (*reader)->next(batch);
      if (!more) return state.SkipWithError(more.error().message.c_str());
      if (!*more) break;
      points += batch.size();
    }
    if (points != point_count()) return state.SkipWithError("points are missing");
  }
  finish(state, folder / format.file);
}

/// 31 bytes per point (PLY's record) in pieces of a megabyte.
void reference(benchmark::State& state, bool reading) {
  const ScratchFolder folder;
  const std::filesystem::path path = folder / "bytes";
  const std::string piece(std::size_t{1} << 20, 'x');
  const std::uint64_t pieces = 31 * point_count() / piece.size() + 1;
  const auto write = [&] {
    auto file = AtomicFile::create(path);
    for (std::uint64_t i = 0; file && i < pieces; ++i) file->write(piece);
    return file && file->commit();
  };
  const auto read = [&] {
    std::string buffer(piece.size(), '\0');
    std::ifstream in(path, std::ios::binary);
    while (in.read(buffer.data(), static_cast<std::streamsize>(buffer.size())))
      benchmark::DoNotOptimize(buffer.data());
    return true;
  };
  if (!write()) return state.SkipWithError("cannot write");
  for (auto _ : state)
    if (!(reading ? read() : write())) return state.SkipWithError("cannot write");
  finish(state, path);
}

CloudWriteOptions with(double e57_step_mm, CloudWriteOptions::Pcd pcd) {
  CloudWriteOptions options;
  options.e57_step_mm = e57_step_mm;
  options.pcd = pcd;
  return options;
}

const std::array kFormats{
    Format{"E57", "a.e57", {}},
    Format{"E57_steps", "a.e57", with(0.001, {})},
    Format{"PLY", "a.ply", {}},
    Format{"LAS", "a.las", {}},
    Format{"PCD", "a.pcd", {}},
    Format{"PTX", "a.ptx", {}},
    Format{"PTS", "a.pts", {}},
    Format{"XYZ", "a.xyz", {}},
    Format{"PCD_packed", "a.pcd", with(0.0, CloudWriteOptions::Pcd::binary_compressed)},
};

const bool kRegistered = [] {
  for (const bool reading : {false, true})
    benchmark::RegisterBenchmark(reading ? "read/bytes" : "write/bytes", reference, reading)
        ->Unit(benchmark::kMillisecond);
  for (const Format& format : kFormats) {
    benchmark::RegisterBenchmark((std::string("write/") + format.name).c_str(), write_format,
                                 format)
        ->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark((std::string("read/") + format.name).c_str(), read_format, format)
        ->Unit(benchmark::kMillisecond);
  }
  return true;
}();

}  // namespace
}  // namespace maquette::scan
