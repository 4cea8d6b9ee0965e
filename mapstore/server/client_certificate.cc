// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/client_certificate.h"

#include <openssl/x509.h>

#include <optional>
#include <utility>
#include <vector>

#include "mapstore/core/pem.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::server {
namespace {

template <typename... Args>
Status Unauthenticated(fmt::format_string<Args...> format, Args&&... args) {
  return MakeStatus(StatusCode::kUnauthenticated, format, std::forward<Args>(args)...);
}

// The entry of a name in UTF-8; nothing if there is none, or several, or it is no text.
std::optional<std::string> OnlyEntry(X509_NAME* name, int nid) {
  const int index = X509_NAME_get_index_by_NID(name, nid, -1);
  if (index < 0 || X509_NAME_get_index_by_NID(name, nid, index) >= 0) return std::nullopt;
  unsigned char* utf8 = nullptr;
  const int size =
      ASN1_STRING_to_UTF8(&utf8, X509_NAME_ENTRY_get_data(X509_NAME_get_entry(name, index)));
  if (size < 0) return std::nullopt;
  std::string text(reinterpret_cast<const char*>(utf8), static_cast<std::size_t>(size));
  OPENSSL_free(utf8);
  return text;
}

}  // namespace

StatusOr<ClientCertificate> ReadClientCertificate(const std::string& pem) {
  const ForgottenErrors forgotten;
  const std::vector<std::shared_ptr<X509>> certificates = CertificatesOfPem(pem);
  if (certificates.empty()) return Unauthenticated("no client certificate");
  const std::shared_ptr<X509>& x509 = certificates.front();
  X509_NAME* const subject = X509_get_subject_name(x509.get());
  const std::optional<std::string> name = OnlyEntry(subject, NID_commonName);
  if (!name || !CheckReportText("CN", *name).ok()) {
    return Unauthenticated("client certificate: expected one CN, the client's name");
  }
  const std::optional<std::string> unit = OnlyEntry(subject, NID_organizationalUnitName);
  const std::optional<Role> role = unit ? RoleOf(*unit) : std::nullopt;
  if (!role) {
    return Unauthenticated(
        "client certificate of '{}': OU '{}', expected vehicle, mapper, inspector or operator",
        *name,
        unit.value_or(""));
  }
  const std::optional<CertificateTimes> times = TimesOf(x509.get());
  if (!times) return Unauthenticated("client certificate of '{}': no dates", *name);
  return ClientCertificate{*name, *role, times->begin, times->end, x509};
}

}  // namespace shiftmap::server
