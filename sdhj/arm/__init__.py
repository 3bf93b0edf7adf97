"""The paper's robot: a two-link arm among moving disks, and its two case studies (Sec. 5 and 6.1)."""
