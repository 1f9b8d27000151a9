"""Registration of two scans of a place."""

from revisit._core.registration import PreparedScan, Registration, RegistrationOptions, register_scans

__all__ = ['PreparedScan', 'Registration', 'RegistrationOptions', 'register_scans']
