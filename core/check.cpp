// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/check.hpp"

namespace maquette {

void check_failed(const char* file, int line, const char* condition, const std::string& detail) {
  throw CheckFailed(fmt::format("{}:{}: check failed: {} ({})", file, line, condition, detail));
}

}  // namespace maquette
