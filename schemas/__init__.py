"""What travels between Kirotei's services: topics, messages, and their encoding."""
