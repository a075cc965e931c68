"""What several commands share: the client of the service, child processes, progress, sentences, exit statuses."""
